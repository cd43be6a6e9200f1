"""Mitsuba 3 as a second opinion: pictures rendered again and again until their noise is small enough.

Its fog is met at random on every way, and of a thin shaft of sunlight by few paths: how many a picture needs is not
known before.
"""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Callable

import numpy as np

from pipeline.errors import InputError
from pipeline.imaging.atomic import replacing
from pipeline.plugins.base import Medium
from pipeline.plugins.registry import registry
from pipeline.rendering.describe import describe
from pipeline.scene.placed import PlacedScene

#: Most paths a pixel of one pass, most paths of all its pixels, and passes of the first round; each round doubles them.
PASS, AT_ONCE, FIRST = 2048, 1 << 22, 4
#: Several times as fast where it works; LLVM of some systems stops the whole process on it. The other works everywhere.
FAST, SAFE = "llvm_ad_rgb", "scalar_rgb"
PROBE = f"""
import mitsuba
mitsuba.set_variant("{FAST}")
scene = {{"type": "scene", "integrator": {{"type": "volpath"}}, "lamp": {{"type": "constant"}},
         "sensor": {{"type": "perspective", "film": {{"type": "hdrfilm", "width": 4, "height": 4}}}},
         "ball": {{"type": "sphere", "center": [0, 0, 5], "bsdf": {{"type": "diffuse"}}}}}}
mitsuba.render(mitsuba.load_dict(scene), spp=4).numpy()
"""
PROBE_SECONDS = 120
#: Below this share of the brightest a pixel is black beside it.
BLACK = 1e-3


@dataclass(frozen=True)
class Estimate:
    """A picture (H, W, 3) that was found by chance, and the standard error of it."""

    mean: np.ndarray
    error: np.ndarray

    @classmethod
    def of(cls, passes: list[np.ndarray]) -> "Estimate":
        """The mean of independent passes."""
        return cls(np.mean(passes, 0), np.std(passes, 0, ddof=1) / np.sqrt(len(passes)))

    @classmethod
    def ratio(cls, over: list[np.ndarray], under: list[np.ndarray]) -> "Estimate":
        """The ratio of the means of passes that belong together, NaN where the lower is 0."""
        below = _or_nan(np.mean(under, 0))
        ratio = np.mean(over, 0) / below
        return cls(ratio, cls.of([o - ratio * u for o, u in zip(over, under)]).error / below)

    @classmethod
    def total(cls, parts: list["Estimate"]) -> "Estimate":
        return cls(sum(part.mean for part in parts), np.sqrt(sum(part.error**2 for part in parts)))

    @classmethod
    def quotient(cls, over: "Estimate", under: "Estimate") -> "Estimate":
        """The ratio of two that were found apart, NaN where the lower is 0."""
        below = _or_nan(under.mean)
        ratio = over.mean / below
        return cls(ratio, np.hypot(over.error, ratio * under.error) / below)

    def used(self, seen: np.ndarray) -> np.ndarray:
        """Where (H, W, 3), of the pixels `seen` (H, W), it is known and not black beside its brightest."""
        known = seen[..., None] & np.isfinite(self.mean)
        return known & (self.mean > BLACK * np.max(self.mean, where=known, initial=0.0))

    def noise(self, seen: np.ndarray) -> float:
        """Median relative standard error, 0 where nothing is seen."""
        used = self.used(seen)
        return float(np.median(self.error[used] / self.mean[used])) if used.any() else 0.0


def _or_nan(values: np.ndarray) -> np.ndarray:
    return np.where(values > 0, values, np.nan)


class SecondOpinion:
    """Renders the scene of one fog in Mitsuba, light by light, with scene files beside each other in `folder`."""

    def __init__(self, scene: PlacedScene, medium: Medium, strengths: dict[str, np.ndarray], folder: Path, most: int):
        """most: paths a pixel after which no picture goes on. Raises InputError where Mitsuba is not installed."""
        try:
            import mitsuba
        except ImportError:
            raise InputError("Mitsuba 3 is not installed", place="crosscheck", remedy="run: make setup-mitsuba") from None
        self.variant = FAST if _vectorised() else SAFE
        mitsuba.set_variant(self.variant)
        self.mitsuba, self.exporter_class = mitsuba, registry("exporters")["mitsuba"]
        self.scene, self.medium, self.strengths, self.folder, self.most = scene, medium, strengths, folder, most
        self.samples = max(1, min(PASS, AT_ONCE // (scene.camera.width * scene.camera.height)))
        folder.mkdir(parents=True, exist_ok=True)

    def states(self, light: str) -> bool:
        return self.scene.lights[light].type_name() in self.exporter_class.states

    def in_scattering(self, light: str, seen: np.ndarray, noise: float) -> Estimate:
        """V of a light (H, W, 3), its lamp visible in it, until the noise where `seen` (H, W) is at most `noise`."""
        picture = self._loaded("in_scattering", light)
        passes: list[np.ndarray] = []
        return self._until(noise, seen, lambda seed: passes.append(self._pass(picture, seed)), lambda: Estimate.of(passes))

    def transmittance(self, light: str, seen: np.ndarray, noise: float) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Passes (H, W, 3) of what the light makes white surfaces reflect, in fog on its way alone and without fog."""
        pictures = [self._loaded(what, light) for what in ("transmittance", "clear")]
        fogged, clear = [], []

        def add(seed: int) -> None:
            fogged.append(self._pass(pictures[0], seed))
            clear.append(self._pass(pictures[1], seed))

        self._until(noise, seen, add, lambda: Estimate.ratio(fogged, clear))
        return fogged, clear

    def depth(self, light: str) -> np.ndarray:
        """Radial depth (H, W) [m] at pixel centres, by Mitsuba's own rays; 0 where nothing is met."""
        self.mitsuba.set_variant(SAFE)  # its rays are single ones
        scene, camera = self._loaded("clear", light), self.scene.camera
        sensor = scene.sensors()[0]
        width, height = sensor.film().crop_size()
        result = np.zeros((height, width))
        for v in range(height):
            for u in range(width):
                ray, _ = sensor.sample_ray(0, 0, [(u + 0.5) / width, (v + 0.5) / height], [0.5, 0.5])
                hit = scene.ray_intersect(ray)
                if hit.is_valid():
                    result[v, u] = np.linalg.norm(np.array(hit.p) - camera.position)
        self.mitsuba.set_variant(self.variant)
        return result

    def _until(self, noise: float, seen: np.ndarray, add: Callable[[int], None],
               estimate: Callable[[], Estimate]) -> Estimate:
        done, wanted, last = 0, FIRST, max(FIRST, self.most // self.samples)
        while True:
            for seed in range(done, wanted):
                add(seed)
            done, found = wanted, estimate()
            if found.noise(seen) <= noise or done >= last:
                return found
            wanted = min(2 * done, last)

    def _pass(self, picture, seed: int) -> np.ndarray:
        return np.array(self.mitsuba.render(picture, seed=seed, spp=self.samples), dtype=float)

    def _loaded(self, what: str, light: str):
        exporter, name = self.exporter_class(samples=self.samples), f"{what}_{light}"
        described = describe(what, self.scene, self.medium, self.strengths, [light], {}, exporter)
        for file, content in exporter.export(name, described).items():
            with replacing(self.folder / file) as partial:
                partial.write_bytes(content.encode() if isinstance(content, str) else content)
        return self.mitsuba.load_file(str(self.folder / f"{name}.xml"))


def _vectorised() -> bool:
    """Whether Mitsuba's vectorised code works here, tried in a process of its own, which it may take down."""
    try:
        done = subprocess.run([sys.executable, "-c", PROBE], capture_output=True, timeout=PROBE_SECONDS, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return False
    return done.returncode == 0


def coarse_scene(scene: PlacedScene, size: int) -> PlacedScene:
    """The same scene through a camera of at most `size` pixels a side."""
    camera = scene.camera
    share = min(1.0, size / max(camera.width, camera.height))
    return replace(scene, camera=camera.resized(*(max(1, round(n * share)) for n in (camera.width, camera.height))))
