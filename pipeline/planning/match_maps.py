"""Trial fogs of one view, made as a match asks for them and kept small for the next: coarse steps of visibility first,
finer ones where the match lies."""

from __future__ import annotations

import hashlib
import math
import shutil
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from pipeline.estimation.fog_match import Asked, Match, located, match
from pipeline.estimation.fog_response import Response
from pipeline.imaging.maps import read_map, write_map
from pipeline.imaging.photograph import averaged
from pipeline.paths import INCLUDES, PROJECT, TEMPLATES, Build
from pipeline.physics.visibility import CONTRAST
from pipeline.planning import trial
from pipeline.planning.calibrate import quiet
from pipeline.planning.choosing import TOLERANCE
from pipeline.scene.artefacts import read_json, read_strengths, working, write_json

#: Visibilities that are tried are powers of this [m], so that every match meets the same; coarse steps of so many first,
#: then finer ones round the best so far.
RATIO, STEPS = math.sqrt(2), (4, 2, 1)
#: Optical depths of the nearest twentieth of what is seen in the densest fog, and of the farthest in the thinnest.
DENSEST, THINNEST = 6.0, 0.01
#: Asymmetries that are tried where it is asked for, between which the scattered light is a spline.
ASYMMETRIES = (-0.3, 0.0, 0.3, 0.55, 0.75, 0.88)
#: Trial fogs are averaged over many pixels each: they may be so many times as far off as what the scene asks of its fogs.
COARSER = 2.0
#: Of that error, what it moves a result by; measured on pictures of known fog (visibilities were off by 0.2 to 0.5 %).
SHARE = 0.25
#: Lights with gains of their own, the brightest in the fog; those beyond have one gain together.
MOST_GAINS, OTHERS = 8, "others"
#: Stages up to the maps, and what of the project makes these.
STAGES = ("plan", "emit", "render", "decompose")
SOURCES = ("estimation/fog_response.py", "geometry", "imaging", "physics", "planning", "plugins", "rendering", "stages/plan.py",
           "stages/emit.py", "stages/render.py", "stages/decompose.py")
#: V below this share of what it is in thin fog, by the density, is no digit that counts.
LEAST = 1e-7


class TrialFogs:
    """Small maps of a view, `size` (w, h), in even grey fog of the build's phase function that absorbs nothing."""

    def __init__(self, view: Build, size: tuple[int, int], medium, told: Callable[[str], None]):
        self.view, self.size, self.told = view, size, told
        self.phase = medium.phase().model_dump(mode="json")
        self.clear = np.maximum(read_map(working(view).photograph).astype(float), 0)
        self.lights = [name for name, strength in read_strengths(view).items() if strength.max() > 0]
        self.made_of, self.read = self._made_of(), {}
        settings = read_json(view.input("render"))
        #: relative error asked of the trial fogs
        self.tolerance = min(1.0, COARSER * (settings["tolerance"] or TOLERANCE[settings["quality"]]))

    def response(self, levels: Sequence[int], phases: Sequence[dict]) -> tuple[Response, list[str]]:
        """Of the whole small picture, and the names of the lights, of which the last may be OTHERS."""
        levels = sorted(levels, reverse=True)
        made = [[self._maps(level, phase) for phase in phases] for level in levels]
        glows = np.stack([[maps[1] for maps in row] for row in made])
        extinctions = -np.log(CONTRAST) / np.array([visibility_of_level(level) for level in levels])
        by_density = glows / extinctions[:, None, None, None, None]
        glows = np.maximum(by_density, LEAST * by_density.max((0, 1))) * extinctions[:, None, None, None, None]
        names, order = list(self.lights), np.argsort(-by_density.sum((0, 1, 3, 4)), kind="stable")
        if len(names) > MOST_GAINS:
            own, rest = sorted(order[:MOST_GAINS - 1]), order[MOST_GAINS - 1:]
            glows = np.concatenate([glows[:, :, own], glows[:, :, rest].sum(2, keepdims=True)], 2)
            names = [names[k] for k in own] + [OTHERS]
        clear = averaged(self.clear, self.size).reshape(-1, 3)
        asymmetries = [phase.get("asymmetry", 0.0) for phase in phases]
        return Response.of(extinctions, asymmetries, clear, np.stack([row[0][0] for row in made]), glows), names

    def _maps(self, level: int, phase: dict) -> tuple[np.ndarray, np.ndarray]:
        """R T (N, 3) and V of each light (L, N, 3), made where they are not kept from before."""
        key = level, str(phase)
        if key not in self.read:
            self.read[key] = self._kept(level, phase)
        return self.read[key]

    def _kept(self, level: int, phase: dict) -> tuple[np.ndarray, np.ndarray]:
        visibility = visibility_of_level(level)
        kind = f"g{phase['asymmetry']:g}" if "asymmetry" in phase else phase["type"]
        folder = self.view.trial_maps(f"{visibility:.4g}m_{kind}")
        stamp = folder / "made_of.json"
        fog = {"type": "homogeneous", "visibility": visibility, "phase_function": phase}
        made_of = {"fog": fog, "size_pixel": list(self.size), "lights": self.lights, "sha256": self.made_of}
        # a light's name is a file's, and none is called so
        paths = [folder / "surviving.exr", *(folder / f"in_scattering_{name}.exr" for name in self.lights)]
        if not (stamp.exists() and read_json(stamp) == made_of and all(path.exists() for path in paths)):
            self.told(f"fog of {visibility:.3g} m visibility" + (f", g {phase['asymmetry']:g}" if "asymmetry" in phase else ""))
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir(parents=True)
            for path, values in zip(paths, self._made(fog)):
                write_map(path, averaged(values, self.size), {"fog:content": "R T" if path == paths[0] else "V",
                                                              "fog:visibility_m": visibility})
            write_json(stamp, made_of)
        surviving, *glows = (read_map(path, self.size[::-1]).reshape(-1, 3) for path in paths)
        return surviving, np.stack(glows) if glows else np.zeros((0, *surviving.shape))

    def _made(self, fog: dict) -> list[np.ndarray]:
        with quiet():
            trial.run(self.view, "match", {"tolerance": self.tolerance, "budget": None, "checked_pixels": 0}, fog=fog, stages=STAGES)
        made = trial.of(self.view, "match")
        images = [self.clear * read_map(made.transmittance)]
        for name in self.lights:
            path = made.in_scattering(name)
            images.append(read_map(path) if path.exists() else np.zeros_like(self.clear))
        shutil.rmtree(made.out, ignore_errors=True)
        return images

    def _made_of(self) -> str:
        """Digest of all that the maps are made of, but the fog."""
        view = self.view
        digest = hashlib.sha256()
        files = [view.geometry, view.illumination, view.sun_direction, view.photograph_facts, view.camera]
        files += [view.input(part) for part in ("photograph", "templates", "plugins", "render", "gains", "exporter", "depth")]
        files += [path for part in SOURCES for path in _sources(PROJECT / "pipeline" / part)]
        files += [path for folder in (TEMPLATES, INCLUDES) for path in sorted(folder.rglob("*.inc")) + sorted(folder.rglob("*.pov"))]
        for path in files:
            digest.update(path.name.encode() + b"\0" + (path.read_bytes() if path.exists() else b"") + b"\0")
        return digest.hexdigest()


def _sources(path: Path) -> list[Path]:
    return [path] if path.suffix == ".py" else sorted(path.rglob("*.py"))


def visibility_of_level(level: int) -> float:
    """[m]"""
    return RATIO**level


def levels_of(depth: np.ndarray) -> tuple[int, int]:
    """First and last level, from visibilities in which the nearest is hidden to those in which the farthest is clear."""
    near, far = (float(x) for x in np.percentile(depth, [5, 95]))
    by_ratio = [math.log(max(-math.log(CONTRAST) * length / optical, 1e-3), RATIO)
                for length, optical in ((near, DENSEST), (far, THINNEST))]
    step = STEPS[0]
    first = math.floor(by_ratio[0] / step) * step
    # a spline takes four nodes
    return first, max(math.ceil(by_ratio[1] / step) * step, first + 3 * step)


def matched(fogs: TrialFogs, depth: np.ndarray, used: np.ndarray, reference: np.ndarray, tiles: np.ndarray, asked: Asked
            ) -> tuple[Match, Response, list[str], list[int]]:
    """The match, with the response of the whole small picture by which it was found, the lights' names, and the levels tried.

    depth (N,) [m], used (N,) bool, reference (N, 3), tiles (N, 2).
    """
    first, last = levels_of(depth[used])
    levels = set(range(first, last + 1, STEPS[0]))
    at_first = replace(asked, fit_asymmetry=False)

    def about(levels: set[int]) -> float:
        return located(fogs.response(levels, [fogs.phase])[0].of_pixels(used), reference[used], at_first)

    extinction = about(levels)
    for step in STEPS[1:]:
        while more := _round(extinction, step, 2, first, last) - levels:
            levels |= more
            extinction = about(levels)

    def found(phases: Sequence[dict], levels: set[int], asked: Asked) -> tuple[Match, Response, list[str]]:
        response, names = fogs.response(levels, phases)
        return match(response.of_pixels(used), reference[used], tiles[used], asked, SHARE * fogs.tolerance), response, names

    best = found([fogs.phase], levels, at_first)
    if not asked.fit_asymmetry or not best[0].determined["visibility"]:
        return *best, sorted(levels)
    phases = [{"type": "henyey_greenstein", "asymmetry": g} for g in ASYMMETRIES]
    levels = _round(best[0].extinction, 1, 2, first, last)
    for _ in range(4):
        best = found(phases, levels, asked)
        more = _round(best[0].extinction, 1, 2, first, last)
        if more <= levels:
            break
        levels |= more
    return *best, sorted(levels)


def _round(extinction: float, step: int, count: int, first: int, last: int) -> set[int]:
    """The `count` levels on either side of an extinction [1/m], at multiples of `step`."""
    below = math.floor(math.log(-math.log(CONTRAST) / extinction, RATIO) / step) * step
    return {level for level in range(below - (count - 1) * step, below + count * step + 1, step) if first <= level <= last}


