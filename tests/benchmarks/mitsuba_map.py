"""The same map by Mitsuba 3, in a process of its own: from exported scene files to the map.

    python -m tests.benchmarks.mitsuba_map V build/bench/cornell/export/bench llvm_ad_rgb 64 1

renders 64 paths a pixel with seed 1. V is `in_scattering.xml`; T is what white surfaces reflect in fog that only absorbs,
`transmittance.xml`, over the same without fog, `clear.xml`, and lacks the way from the surface to the eye.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from pipeline.paths import Build
from pipeline.plugins.registry import registry
from pipeline.rendering.describe import describe
from pipeline.rendering.second_opinion import AT_ONCE
from pipeline.scene.artefacts import read_fog, read_placed, read_strengths

WHATS = {"V": ["in_scattering"], "T": ["transmittance", "clear"]}


def file_of(folder: Path, name: str, samples: int) -> Path:
    return folder / f"{name}_{samples}.npy"


def export(build: Build, folder: Path) -> None:
    """The scene files of both maps, of all lights that Mitsuba can state, scattered or reflected once."""
    folder.mkdir(parents=True, exist_ok=True)
    exporter, scene = registry("exporters")["mitsuba"](), read_placed(build)
    for what in sum(WHATS.values(), []):
        described = describe(what, scene, read_fog(build), read_strengths(build), list(scene.lights), {}, exporter)
        for file, content in exporter.export(what, described).items():
            (folder / file).write_bytes(content.encode() if isinstance(content, str) else content)


def make(name: str, folder: Path, variant: str, samples: int, seed: int) -> None:
    """Renders in as many passes as memory asks for."""
    import mitsuba

    mitsuba.set_variant(variant)
    pictures = []
    for what in WHATS[name]:
        scene = mitsuba.load_file(str(folder / f"{what}.xml"))
        most = max(1, AT_ONCE // int(np.prod(scene.sensors()[0].film().crop_size())))
        passes = [len(part) for part in np.array_split(np.arange(samples), -(-samples // most))]
        pictures.append(sum(count * np.array(mitsuba.render(scene, seed=seed * 10_000 + k, spp=count), dtype=float)
                            for k, count in enumerate(passes)) / samples)
    if name == "T":
        pictures = [pictures[0] / np.where(pictures[1] > 0, pictures[1], np.nan)]
    np.save(file_of(folder, name, samples), pictures[0].astype(np.float32))


if __name__ == "__main__":
    make(sys.argv[1], Path(sys.argv[2]), sys.argv[3], int(sys.argv[4]), int(sys.argv[5]))
