"""The light and the fog of a scene at draft quality, small: by the stages' own functions, in a build folder of the preview's."""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from pipeline import chain
from pipeline.annotate.preview.picture import Picture
from pipeline.annotate.preview.placing import Placed
from pipeline.annotate.preview.problems import Parts
from pipeline.annotate.preview.scaled import scaled
from pipeline.errors import InputError
from pipeline.geometry.visibility import visible
from pipeline.imaging.maps import write_map
from pipeline.paths import Build
from pipeline.planning.calibrate import quiet
from pipeline.plugins.base import Medium
from pipeline.rendering import povray
from pipeline.rendering.emit import Run, Templates, emit, write_side_files
from pipeline.rendering.fineness import INTEGRATED, Fineness
from pipeline.rendering.fineness import as_json as fineness_json
from pipeline.rendering.own_templates import rendered_for_their_templates, surfaces_are_ours
from pipeline.rendering.runs import as_json, fog_runs, glow_size, hidden, irradiance_run, shaded_lights
from pipeline.rendering.separated_lights import at_estimate_size, bounce_jobs, bounce_runs, first_albedos, irradiance_jobs
from pipeline.scene.artefacts import (
    camera_to_json, plugin_from_json, read_fog, read_json, read_placed, write_json, write_json_if_changed)
from pipeline.scene.model import CompositeSettings, RenderSettings
from pipeline.scene.placed import PlacedScene

#: Longer side [pixel] at which light and fog are worked out, outdoors, where closed forms say most, and indoors.
OUTDOORS, INDOORS = 256, 160
#: What is rendered of the fog, at these settings. All of it together takes POV-Ray less than it takes to start and end.
FINENESS = Fineness(in_scattering_size=36, glow_tolerance=0.1, shadow_size=32, samples=6, shadow_lights=3, shaft_samples=12,
                    optical_step=2 / 3, density_steps=32, transmittance=INTEGRATED)
#: What finds the glow of lamps where it need not be right but at once.
COARSE_GLOW = {"in_scattering_size": 24, "glow_tolerance": 0.1}
#: Of the estimate of light strengths: longer side [pixel], rays, bounces at most, and side of the square of small lights.
ESTIMATE_SIZE, RAYS, BOUNCES, SUB_LIGHTS = 40, 12, 2, 3
#: Share of rays and points along them at which what stands round the fog is looked up.
SURROUNDINGS = 0.6
#: Albedos that come out nearer than this to those that bounced light was rendered with need no other render.
ALIKE = 0.04


class Cancelled(Exception):
    """Another state of the scene is wanted."""


@dataclass(frozen=True)
class Draft:
    """What the fog's maps are made from: build holds the files of the geometry, the light and the fog's renders.

    lights: that reach the fog. medium: the fog that was rendered. glows: V (h, w, 3) of lights at unit strength without
    shadows, at the size at which glow is found. is_rough: nothing was rendered, and the light is that of another geometry.
    """

    build: Build
    lights: list[str]
    medium: Medium
    glows: dict[str, np.ndarray] = field(default_factory=dict)
    is_rough: bool = False


@dataclass(frozen=True)
class _Lit:
    """What the last estimate of the light was made for."""

    photograph: str
    lights: list[str]
    faces: list[str]


class Drafting:
    """Works out drafts, one after the other, and again only what a change concerns."""

    def __init__(self, build: Build):
        self.build = build
        self._done: dict[str, str] = {}
        self._begun: dict[str, list[float]] = {}
        self._lit: _Lit | None = None

    def of(self, parts: Parts, picture: Picture, placed: Placed, told: Callable[[str], None],
           meanwhile: Callable[[], None], roughly: Callable[[Draft], None]) -> Draft:
        """told(stage): called before each step; what it raises ends the work. meanwhile(): what needs the geometry alone,
        while POV-Ray renders. roughly(draft): called before that, where the light is to be estimated anew and the last one
        says something of it. Raises InputError as the stages do.
        """
        build = self.build
        told("geometry")
        longer_side = OUTDOORS if parts.depth is not None else INDOORS
        geometry = self._write_inputs(parts, picture, placed, longer_side)
        if self._done.get("geometry") != geometry:
            self._done.pop("light", None)
            self._done.pop("geometry", None)
            self._chain("geometry")
            self._done["geometry"] = geometry
        told("fog")
        scene, medium = read_placed(build), read_fog(build)
        # how many rounds it takes is no matter: later ones begin where the last one ended
        light = _digest([geometry, parts.illumination.model_dump_json(), *(path.read_text(encoding="utf-8") for path in (
            build.input("strengths"), build.input("exporter"), build.sun_direction))])
        draft, runs = self._fog_plan(scene, medium)
        before = self._by_the_light_before(scene, draft) if self._done.get("light") != light else None
        if before is not None:
            roughly(before)
        told("renders")
        fog_jobs = self._fog_jobs(scene, medium, runs)
        light_jobs = self._light_jobs(scene) if self._done.get("light") != light else []
        timeout = read_json(build.input("render"))["timeout"]
        with ThreadPoolExecutor(1) as beside:
            rendering = beside.submit(povray.render_together, light_jobs + fog_jobs, threads=None, timeout=timeout,
                                      told=lambda index, seconds: told("renders"))
            meanwhile()
            glows = {name: self._glow(scene, medium, name) for name in draft.lights}
            rendering.result()
        if self._done.get("light") != light:
            told("light")
            self._done.pop("light", None)
            self._lit = None
            self._chain("illumination")
            self._done["light"] = light
            self._lit = _Lit(self._done["photograph"], list(scene.lights), read_json(build.geometry)["faces"])
            self._keep_albedos()
        told("maps")
        return replace(draft, glows={name: glow for name, glow in glows.items() if glow is not None})

    @property
    def geometry(self) -> str:
        """By which the geometry of the last draft is told."""
        return self._done.get("geometry", "")

    def _chain(self, stage: str) -> None:
        with quiet():
            chain.run(self.build, [stage], done=lambda name, seconds: None)

    def _write_inputs(self, parts: Parts, picture: Picture, placed: Placed, longer_side: int) -> str:
        """Writes what the stages read; a digest of what the geometry is made from."""
        build = self.build
        radiance, clipped = picture.reduced(longer_side)
        height, width = clipped.shape
        factor = width / picture.width
        lights, strengths = {}, {}
        for name, light in placed.lights.items():
            if ("lights", name) in placed.left_out:
                continue
            if hasattr(light, "sub_lights"):
                light = light.model_copy(update={"sub_lights": min(light.sub_lights, SUB_LIGHTS)})
            stated = light.model_dump(mode="json")
            stated.pop("gain")
            strengths[name] = stated.pop(light.strength_name)
            lights[name] = stated
        if not lights:
            raise InputError("there is no light that could be in the fog", place=f"{build.scene_file} (lights)",
                             remedy="outline a lamp, a window or the sun's patch, or mend those that are there")
        illumination = scaled(parts.illumination, factor)
        if hasattr(illumination, "rays"):
            rounds = 1 if self._begun else min(2, illumination.rounds)
            illumination = illumination.model_copy(update={
                "size": min(illumination.size, ESTIMATE_SIZE), "rays": min(illumination.rays, RAYS),
                "bounces": min(illumination.bounces, BOUNCES), "rounds": rounds})
        depth = None if parts.depth is None else scaled(parts.depth, factor).model_dump(mode="json", by_alias=True)
        if depth is not None:
            for key in placed.left_out:
                if key[:2] == ("depth", "regions"):
                    depth["regions"].pop(key[2], None)
        stated = {
            "photograph": {**parts.photograph.model_dump(mode="json"), "working_size": None, "sha256": ""},
            "depth": depth, "shapes": {name: shape.model_dump(mode="json") for name, shape in placed.shapes.items()},
            "lights": lights, "strengths": strengths, "gains": dict.fromkeys(lights, 1.0),
            "illumination": illumination.model_dump(mode="json"),
            "exporter": parts.exporter.model_dump(mode="json"), "fog": parts.fog.model_dump(mode="json"),
            "render": RenderSettings(quality="draft", checked_pixels=0).model_dump(mode="json"),
            "composite": CompositeSettings().model_dump(mode="json"), "demand": {"light_strengths": True, "surroundings": SURROUNDINGS}}
        for part, value in stated.items():
            write_json_if_changed(build.input(part), value)
        write_json_if_changed(build.camera, camera_to_json(placed.camera.resized(width, height)))
        write_json_if_changed(build.sun_direction, {"suns": {name: _without_nan(sun) for name, sun in placed.suns.items()}})
        seen = _digest([radiance.tobytes(), clipped.tobytes()])
        if self._done.get("photograph") != seen:
            build.shared.mkdir(parents=True, exist_ok=True)
            write_map(build.photograph, radiance, {"fog:content": "photograph, linear scene-referred Rec.709"})
            write_map(build.clipped, clipped.astype(np.float32), {"fog:content": "1 where clipped"})
            self._done["photograph"] = seen
        write_json_if_changed(build.photograph_facts, {"width_pixel": width, "height_pixel": height, "suffix": ".exr",
                                                       "clipped_share": float(clipped.mean()), "focal_length_35mm_mm": None})
        return _digest([seen, build.camera.read_text(encoding="utf-8"),
                        *(build.input(part).read_text(encoding="utf-8") for part in ("depth", "shapes", "lights"))])

    def _light_jobs(self, scene: PlacedScene) -> list[tuple]:
        """What the estimate of the light will render first, so that it finds it done."""
        build, templates = self.build, Templates(self.build.source)
        jobs = irradiance_jobs(build, scene, [irradiance_run(scene, light) for light in filter(scene.rendered, scene.lights)],
                               templates)
        settings = plugin_from_json("estimators", read_json(build.input("illumination")))
        strengths = read_json(build.input("strengths"))
        if settings.type != "karsch" or all(strengths[name] is not None for name in scene.lights):
            return jobs
        small = at_estimate_size(scene, settings)
        begun = read_json(build.albedos_begun) if build.albedos_begun.exists() else None
        return jobs + bounce_jobs(build, small, bounce_runs(small, settings, 0), first_albedos(scene, settings, begun), templates)

    def _fog_plan(self, scene: PlacedScene, medium: Medium) -> tuple[Draft, list[Run]]:
        """The fog's plan, written where the maps' maker reads it."""
        build = self.build
        lights = [] if medium.is_clear() else [name for name in scene.lights if not hidden(scene, medium, name)]
        shaded = shaded_lights(scene, dict.fromkeys(lights, 1.0))
        templates = Templates(build.source)
        by_template = rendered_for_their_templates(templates, scene, medium)
        runs = fog_runs(scene, medium, lights, FINENESS, shaded, by_template, surfaces_are_ours(templates, scene)) if lights else []
        write_json(build.plan, {"fineness": fineness_json(FINENESS), "lights": lights, "runs": [as_json(run) for run in runs],
                                "check": None, "fog_is_clear": medium.is_clear()})
        return Draft(build, lights, medium), runs

    def _fog_jobs(self, scene: PlacedScene, medium: Medium, runs: list[Run]) -> list[tuple]:
        """What to render for it."""
        build, templates = self.build, Templates(self.build.source)
        build.pov.mkdir(parents=True, exist_ok=True)
        write_side_files(build.pov, medium)
        povray.version()  # asked for once, not by each of the renders
        return [self._written(run, emit(run, scene, templates, medium=medium)) for run in runs]

    def _by_the_light_before(self, scene: PlacedScene, draft: Draft) -> Draft | None:
        """A draft of this geometry without renders, in a folder of its own: what the light's estimate was made from stays there
        while it is made anew. None where that was another photograph's, or of other lights."""
        lit, build = self._lit, self.build
        if lit is None or (lit.photograph, lit.lights) != (self._done["photograph"], list(scene.lights)):
            return None
        rough = replace(build, builds=build.builds.with_name("rough"))
        shutil.rmtree(rough.shared, ignore_errors=True)
        shutil.copytree(build.shared, rough.shared, copy_function=_linked, ignore=shutil.ignore_patterns("pov", "runs"))
        write_json(rough.plan, {**read_json(build.plan), "runs": [], "fineness": fineness_json(replace(FINENESS, **COARSE_GLOW))})
        if lit.faces != read_json(build.geometry)["faces"]:
            # what stands round the fog is told by faces
            write_json(rough.illumination, {**read_json(rough.illumination), "surroundings": None})
        return Draft(rough, draft.lights, draft.medium, is_rough=True)

    def _glow(self, scene: PlacedScene, medium: Medium, name: str) -> np.ndarray | None:
        """As `Scattered` finds it; None where it finds none small."""
        light = scene.lights[name]
        if not (scene.rendered(name) and light.smooth and scene.completes(name, medium) and medium.coefficients()[1].max() > 0):
            return None
        camera = scene.camera.resized(*glow_size(scene.camera.width, scene.camera.height, FINENESS.in_scattering_size))
        depth = visible(camera, scene.shapes, scene.lights)[0]
        if not np.isfinite(depth).all():
            return None
        return light.glow(medium, camera.position, camera.directions(camera.pixel_centres()), depth, FINENESS.glow_tolerance)

    def _written(self, run: Run, text: str) -> tuple:
        path = self.build.pov / f"{run.id}.pov"
        path.write_text(text, encoding="utf-8")
        return path, self.build.runs / f"{run.id}.exr", run.width, run.height

    def _keep_albedos(self) -> None:
        """The next estimate begins where this one ended: one round then does what two do from nothing."""
        found = read_json(self.build.illumination)["face_albedo"]
        if any(name not in self._begun or np.abs(np.subtract(one, self._begun[name])).max() > ALIKE for name, one in found.items()):
            self._begun = {**self._begun, **found}
            write_json(self.build.albedos_begun, self._begun)


def _linked(source: str, target: str) -> None:
    """A second name of a file: what replaces the first leaves what was there under the second."""
    try:
        os.link(source, target)
    except OSError:  # not every file system has that
        shutil.copyfile(source, target)


def _digest(contents: Iterable[bytes | str]) -> str:
    digest = hashlib.sha256()
    for one in contents:
        digest.update(one.encode() if isinstance(one, str) else one)
        digest.update(b"\0")
    return digest.hexdigest()


def _without_nan(sun: dict[str, Any]) -> dict[str, Any]:
    """What JSON can hold of a sun whose confidence was not worked out."""
    return {key: None if isinstance(value, float) and not np.isfinite(value) else value for key, value in sun.items()}
