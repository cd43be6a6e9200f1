"""What a scene looks like in fog, while it is annotated: the pipeline at draft quality, in process."""

from __future__ import annotations

import shutil
import threading
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.annotate.picture import Picture, Pictures
from pipeline.annotate.placing import Placed, Placing
from pipeline.annotate.problems import Parts, Problem, checked
from pipeline.annotate.shown import Shown, shown
from pipeline.errors import InputError
from pipeline.imaging.display import displayed
from pipeline.paths import Build

__all__ = ["Preview", "Problem", "Shown"]


class Preview:
    """The preview of one scene, whose data may change from call to call.

    scenes/NAME holds the photograph and what else the data names; `folder` is the preview's own, made here and removed by
    `close`. megapixels: of the picture that is shown, at most. Calls may come from several threads.
    """

    def __init__(self, scenes: Path, name: str, folder: Path, megapixels: float = 1.0):
        self.folder = Path(folder)
        self.folder.mkdir(parents=True)
        self.build = Build(name, None, Path(scenes), self.folder / "build")
        self._pictures = Pictures(self.build, megapixels)
        self._placing = Placing(self.build)
        self._lock = threading.RLock()

    def geometry(self, data: dict[str, Any]) -> tuple[Shown | None, list[Problem]]:
        """What is drawn over the photograph, and what is wrong or still to be drawn; None without a photograph.

        data: of the scene, as the document gives it, complete or not. Raises nothing for what it says.
        """
        with self._lock:
            parts, picture, placed, problems = self._placed(data)
        if picture is None:
            return None, problems
        return shown(parts, placed, (picture.width, picture.height)), problems

    def photograph(self, data: dict[str, Any]) -> np.ndarray:
        """The photograph (h, w, 3) uint8 sRGB, of the size at which fog is shown. Raises InputError if it cannot be read."""
        with self._lock:
            parts, _ = checked(data)
            if parts.photograph is None:
                raise InputError("no photograph is named", remedy="give the photograph's 'file'", place=str(self.build.scene_file))
            picture = self._pictures.of(parts.photograph)
        return displayed(picture.radiance, picture.exposure)

    def close(self) -> None:
        """Removes the preview's folder."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def _placed(self, data: dict[str, Any]) -> tuple[Parts, Picture | None, Placed, list[Problem]]:
        parts, problems = checked(data)
        if parts.photograph is None:
            return parts, None, Placed(), problems
        try:
            picture = self._pictures.of(parts.photograph)
        except InputError as error:
            return parts, None, Placed(), [*problems, Problem.of(error, ("photograph", "file"))]
        placed, found = self._placing.of(parts, (picture.width, picture.height), picture.focal_length_35mm)
        return parts, picture, placed, problems + found
