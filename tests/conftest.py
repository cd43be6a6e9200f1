"""A scene so small that the whole chain takes seconds, for tests that run the real command line."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import imagecodecs
import numpy as np
import pytest

from pipeline.cli import main
from pipeline.paths import Build

#: Up to the first maps; `report` shows what these wrote.
CHAIN = ("resolve", "photograph", "camera", "geometry", "sun_direction", "illumination", "plan", "emit",
         "render",
         "decompose", "composite")

TINY = """\
photograph:
  file: photograph.png
camera:
  horizontal_field_of_view: 70
  position: [0, 1.2, 0]
  look_at: [0, 1.2, -5]
shapes:
  room:
    type: room
    lower: [-2, 0, -5]
    upper: [2, 2.5, 1]
lights:
  lamp:
    type: area
    outline:
      points: [[-0.4, 2.49, -3.4], [0.4, 2.49, -3.4], [0.4, 2.49, -2.6], [-0.4, 2.49, -2.6]]
    radiance: [4, 4, 4]
    sub_lights: 2
  bulb:
    type: point
    position:
      point: [1.2, 1.4, -4]
    intensity: [0.5, 0.4, 0.3]
fog:
  type: homogeneous
  visibility: 6
  phase_function:
    type: isotropic
fogs:
  thick:
    type: homogeneous
    visibility: 2
render:
  samples: 8
"""


@dataclass
class TinyScene:
    """A scene called `tiny` in folders of its own, and the command line to run on it."""

    root: Path
    name: str = "tiny"

    @property
    def build(self) -> Build:
        return Build(self.name, None, self.root / "scenes", self.root / "build")

    @property
    def folder(self) -> Path:
        return self.build.source

    @property
    def file(self) -> Path:
        return self.build.scene_file

    def replace(self, old: str, new: str) -> None:
        """Edits the scene file; what is replaced must be there."""
        text = self.file.read_text()
        assert old in text, f"{old!r} is not in the scene file"
        self.file.write_text(text.replace(old, new, 1))

    def line(self, words: str) -> int:
        """Number of the scene file's first line that holds `words`."""
        return next(n for n, text in enumerate(self.file.read_text().splitlines(), 1) if words in text)

    def run(self, *stages: str, fog: str | None = None, overrides: tuple[str, ...] = (),
            scene: str | None = None) -> int:
        """Exit status of the first stage that fails, or 0."""
        options = ["--scene", self.name if scene is None else scene, "--scenes", str(self.root / "scenes"),
                   "--build", str(self.root / "build"), *(["--fog", fog] if fog is not None else [])]
        for stage in stages or CHAIN:
            sets = [word for override in overrides for word in ("--set",
                                                                override)] if stage == "resolve" else []
            status = main([stage, *options, *sets])
            if status:
                return status
        return 0


@pytest.fixture
def tiny_scene(tmp_path, monkeypatch) -> TinyScene:
    """A valid 24x18 scene: a room, an area lamp and a bulb of known strengths, homogeneous fog."""
    for name in ("FOG_SCENE", "FOG_NAME", "FOG_OVERRIDES", "FOG_SCENES", "FOG_BUILD"):
        monkeypatch.delenv(name, raising=False)
    scene = TinyScene(tmp_path)
    write_tiny(scene.folder)
    return scene


def write_tiny(folder: Path) -> None:
    """The scene file and its photograph."""
    folder.mkdir(parents=True)
    (folder / "scene.yaml").write_text(TINY)
    v, u = np.mgrid[0:18, 0:24]
    codes = np.stack([60 + 5 * u, 80 + 6 * v, np.full_like(u, 90)], -1).astype(np.uint8)
    (folder / "photograph.png").write_bytes(imagecodecs.png_encode(codes))
