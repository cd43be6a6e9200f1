"""What a scene looks like in fog, while it is annotated: the pipeline at draft quality, in process.

`geometry` says what the annotations mean, `estimate` makes maps of light and fog, and `foggy` shows them in any fog.
"""

from __future__ import annotations

import re
import shutil
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.annotate.preview.display import Display
from pipeline.annotate.preview.drafting import Cancelled, Draft, Drafting
from pipeline.annotate.preview.picture import Picture, Pictures
from pipeline.annotate.preview.placing import Placed, Placing
from pipeline.annotate.preview.problems import Parts, Place, Problem, checked
from pipeline.annotate.preview.scenery import sceneries
from pipeline.annotate.preview.shown import Shown, shown
from pipeline.annotate.preview.sliders import Sliders
from pipeline.errors import InputError
from pipeline.geometry.visibility import seen_along
from pipeline.imaging.display import displayed
from pipeline.paths import Build
from pipeline.scene.artefacts import read_json

__all__ = ["Preview", "Problem", "Shown"]

#: Parts of a scene that `foggy` takes as values of its own, and those that change no draft.
APART = ("fog", "fogs", "render", "composite")
#: Share of the pixels in which a rough picture is shown, and one that follows a slider.
ROUGH, QUICK = 0.2, 0.4
#: Seconds after an estimate before its sliders' maps are made.
REST = 0.4
#: Seconds in which a rough picture is made and sent, with nothing beside it.
SHOWING = 0.15
#: Seconds for which these wait for whoever moves a slider.
PAUSE = 0.3


@dataclass(frozen=True)
class _Made:
    """A complete estimate: of which data, and what shows it."""

    key: str
    fog: str
    sliders: Sliders
    display: Display
    quick: Display
    lamps: dict[int, str]
    gains: dict[str, float]
    exposure: float


class Preview:
    """The preview of one scene, whose data may change from call to call.

    scenes/NAME holds the photograph and what else the data names; `folder` is the preview's own, made here and removed by
    `close`. megapixels: of the picture that is shown, at most. `data` is the whole scene as the document gives it, complete or
    not. Calls may come from several threads: `geometry` and `foggy` do not wait for an `estimate` that is under way.
    """

    def __init__(self, scenes: Path, name: str, folder: Path, megapixels: float = 1.0):
        self.folder = Path(folder)
        self.folder.mkdir(parents=True)
        self.build = Build(name, None, Path(scenes), self.folder / "build")
        self._pictures = Pictures(self.build, megapixels)
        self._placing = Placing(self.build)
        self._drafting = Drafting(self.build)
        self._lock, self._estimating = threading.RLock(), threading.Lock()
        self._wanted = 0
        self._made: _Made | None = None
        self._scenery: tuple[Any, Any] = (None, None)
        self._placed_last = Placed()
        self._data_last: Any = None
        self._shown_last = 0.0

    def geometry(self, data: dict[str, Any]) -> tuple[Shown | None, list[Problem]]:
        """What is drawn over the photograph, and what is wrong or still to be drawn; None without a photograph.

        Raises nothing for what the data says.
        """
        with self._lock:
            parts, picture, placed, problems = self._place(data)
            self._placed_last, self._data_last = placed, parts.photograph
            if picture is None:
                return None, problems
            return shown(parts, placed, (picture.width, picture.height)), problems

    def planes(self) -> list[str]:
        """Names of planes on which something may be put now, by the last `geometry`."""
        return sorted(self._placed_last.planes)

    def plane_at(self, pixel: list[float]) -> str | None:
        """The plane that a pixel of the photograph shows, by the last `geometry`; None for none."""
        placed = self._placed_last
        if placed.camera is None:
            return None
        ray = placed.camera.directions(np.asarray(pixel, float))[None, None]
        depth, face, _ = (found[0, 0] for found in seen_along(placed.camera.position, ray, placed.shapes, {}))
        if np.isfinite(depth):
            return [f"{name}.{one}" for name, shape in placed.shapes.items() for one in shape.faces()][int(face)]
        if placed.regions is None:
            return None
        scale = np.divide([placed.view.width, placed.view.height], [placed.camera.width, placed.camera.height])
        column, row = np.clip((np.asarray(pixel) * scale).astype(int), 0, [placed.view.width - 1, placed.view.height - 1])
        region = placed.regions.regions[placed.regions.labels[row, column]]
        if region.kind == "support" and region.near is None:
            return "ground"
        return region.name if region.name in placed.planes else None

    def photograph(self, data: dict[str, Any]) -> np.ndarray:
        """The photograph (h, w, 3) uint8 sRGB, of the size at which fog is shown. Raises InputError if it cannot be read."""
        with self._lock:
            picture = self._picture(checked(data)[0])
        return displayed(picture.radiance, picture.exposure)

    def estimate(self, data: dict[str, Any], rough: Callable[[], None] = lambda: None) -> list[Problem]:
        """Makes the maps of light and fog of this data, at draft quality; all problems there are, `geometry`'s among them.

        What is broken is left out where there is something without it. A call ends one that is under way; that one leaves
        the maps as they were, as does a scene that no fog can be made of: `is_current` says whether they are of this data.
        rough(): called in between, where the geometry is another: until the light is known anew `foggy` shows that in the light
        that was there before, without shadows in the fog and with fewer pixels.
        """
        with self._lock:
            self._wanted += 1
            mine = self._wanted
        with self._estimating:
            before = self._made

            def told(step: str) -> None:
                if mine != self._wanted:
                    raise Cancelled(step)

            try:
                told("")
                with self._lock:
                    parts, picture, placed, problems = self._place(data)
                if picture is None or not _is_enough(parts, placed):
                    return problems

                def show(made: _Made) -> None:
                    with self._lock:
                        told("")
                        self._made = made

                def roughly(draft: Draft) -> None:
                    try:
                        display = self._drawn(parts, picture.smaller(ROUGH), placed)
                        found = self._of(draft, (display, display), data, parts, placed, "")
                    except InputError:  # the estimate says what is wrong
                        return
                    show(found)
                    rough()
                    time.sleep(SHOWING)

                try:
                    draft = self._drafting.of(parts, picture, placed, told, lambda: self._displays(parts, picture, placed), roughly)
                    made = self._of(draft, self._displays(parts, picture, placed), data, parts, placed, _key(data))
                except InputError as error:
                    self._made = before
                    place = _place_of(error, self.build)
                    if any(one.message == error.problem for one in problems):
                        return problems
                    return [*problems, Problem.of(error, place)]
                told("")
                lights = read_json(self.build.illumination)
                problems += [Problem(("illumination",), message, "see what is marked for the light", "warning")
                             for message in lights["messages"]]
                show(made)
            except Cancelled:
                self._made = before
                return []
        threading.Thread(target=self._prepare, args=(made, mine), daemon=True).start()
        return problems

    def _prepare(self, made: _Made, mine: int) -> None:
        """The sliders' maps, while nobody waits for anything else."""
        def wanted() -> bool:
            while time.monotonic() < self._shown_last + PAUSE:
                time.sleep(PAUSE / 4)
            return self._made is made and self._wanted == mine

        # whoever draws on wants the next estimate first
        time.sleep(REST)
        made.sliders.prepare(wanted)

    def _of(self, draft: Draft, displays: tuple[Display, Display], data: dict[str, Any], parts: Parts, placed: Placed, key: str) -> _Made:
        settings = data.get("composite") if isinstance(data.get("composite"), dict) else {}
        restores, exposure = settings.get("restore_clipped_lamps", True), settings.get("exposure", 0.0)
        lights = read_json(draft.build.illumination)["lights"]
        lamps = {index: name for index, (name, one) in enumerate(lights.items()) if restores and one["quantity"] == "radiance"}
        gains = {name: float(light.gain) for name, light in placed.lights.items()}
        return _Made(key, "" if draft.is_rough else parts.fog.model_dump_json(), Sliders(draft), *displays, lamps, gains,
                     float(exposure) if isinstance(exposure, (int, float)) else 0.0)

    def cancel(self) -> None:
        """Ends an estimate that is under way; the last complete one's maps stay."""
        with self._lock:
            self._wanted += 1

    def is_current(self, data: dict[str, Any]) -> bool:
        """Whether `foggy` shows this data, whatever its fog and gains, which `foggy` is given."""
        made = self._made
        return made is not None and made.key == _key(data)

    def is_exact(self, fog: dict[str, Any] | None) -> bool:
        """Whether the maps were made for this fog, a section of the data, and not only led over to it."""
        made = self._made
        parts = checked({"fog": fog})[0] if fog else None
        return made is not None and parts is not None and parts.fog is not None and parts.fog.model_dump_json() == made.fog

    def foggy(self, fog: dict[str, Any] | None = None, gains: dict[str, float] | None = None, quickly: bool = False) -> np.ndarray:
        """The photograph (h, w, 3) uint8 sRGB in fog, from the last complete estimate; without fog before there is one.

        quickly: with fewer pixels, for somebody who moves a slider.
        fog: values in place of the estimate's: visibility [m], albedo (one, or one a channel), g, height [m] over which it
        falls to 1/e (None for even fog), or any parameter of its type; see `sliders.altered`. gains: by light, in place of
        the scene's. Raises InputError for values that no fog can have.
        """
        made, self._shown_last = self._made, time.monotonic()
        if made is None:
            return self._without_fog()
        given = {**made.gains, **{name: gain for name, gain in (gains or {}).items() if name in made.gains}}
        maps = made.sliders.maps(fog, given)
        if not maps.extinction.any():
            return displayed(made.display.radiance, made.display.exposure * 2.0**made.exposure)
        display = made.quick if quickly else made.display
        return display.picture(maps, {index: maps.strengths[name] for index, name in made.lamps.items()}, made.exposure)

    def close(self) -> None:
        """Ends what is under way, and removes the preview's folder."""
        self.cancel()
        self._made = None
        with self._estimating:
            shutil.rmtree(self.folder, ignore_errors=True)

    def _without_fog(self) -> np.ndarray:
        with self._lock:
            if self._data_last is None:
                raise InputError("there is no photograph yet", remedy="give the photograph's 'file'", place=str(self.build.scene_file))
            picture = self._pictures.of(self._data_last)
        return displayed(picture.radiance, picture.exposure)

    def _picture(self, parts: Parts) -> Picture:
        if parts.photograph is None:
            raise InputError("no photograph is named", remedy="give the photograph's 'file'", place=str(self.build.scene_file))
        return self._pictures.of(parts.photograph)

    def _place(self, data: dict[str, Any]) -> tuple[Parts, Picture | None, Placed, list[Problem]]:
        parts, problems = checked(data)
        if parts.photograph is None:
            return parts, None, Placed(), problems
        try:
            picture = self._pictures.of(parts.photograph)
        except InputError as error:
            return parts, None, Placed(), [*problems, Problem.of(error, ("photograph", "file"))]
        placed, found = self._placing.of(parts, (picture.width, picture.height), picture.focal_length_35mm)
        return parts, picture, placed, problems + found

    def _displays(self, parts: Parts, picture: Picture, placed: Placed) -> tuple[Display, Display]:
        """What the picture shows, whole and with fewer pixels, once as long as the geometry is the same."""
        key = self._drafting.geometry, picture
        if self._scenery[0] != key:
            self._scenery = key, (self._drawn(parts, picture, placed), self._drawn(parts, picture.smaller(QUICK), placed))
        return self._scenery[1]

    def _drawn(self, parts: Parts, picture: Picture, placed: Placed) -> Display:
        small, large, layers = sceneries(self.build, parts, picture, self._placing, placed.camera)
        return Display(picture.radiance, picture.clipped, picture.exposure, large, small, layers)


def _key(data: dict[str, Any]) -> str:
    """By which data is told apart, its fog and gains aside."""
    rest = {key: value for key, value in data.items() if key not in APART}
    lights = rest.get("lights")
    if isinstance(lights, dict):
        rest["lights"] = {name: {key: one for key, one in light.items() if key != "gain"} if isinstance(light, dict) else light
                          for name, light in lights.items()}
    return repr(rest)


def _is_enough(parts: Parts, placed: Placed) -> bool:
    """Whether there is something that fog can be put into."""
    seen = placed.regions is not None or bool(placed.shapes) and parts.depth is None
    return placed.camera is not None and seen and bool(placed.lights) and parts.fog is not None and all(
        part is not None for part in (parts.illumination, parts.sun_direction, parts.exporter))


def _place_of(error: InputError, build: Build) -> Place:
    """Keys of where a stage's error stands, as `artefacts.scene_place` says it without lines."""
    match = re.fullmatch(r".* \(([^()]*)\)", error.place or "")
    return tuple(match[1].split(".")) if match else ()
