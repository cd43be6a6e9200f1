"""The scene once its annotations are resolved: what everything after the geometry stage sees."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.geometry.camera import Camera
from pipeline.plugins.base import Exporter, Light, Shape


@dataclass(frozen=True)
class PlacedScene:
    """A scene in world metres: what exporters see."""

    camera: Camera
    shapes: dict[str, Shape]
    lights: dict[str, Light]
    exporter: Exporter

    def faces(self) -> list[tuple[str, np.ndarray]]:
        """(SHAPE.FACE, (n, 3) [m]) in the order of their indices."""
        return [(f"{name}.{face}", corners) for name, shape in self.shapes.items()
                for face, corners in shape.faces().items()]

    def extent(self) -> float:
        """Radius [m] round the camera that holds everything."""
        points = np.concatenate([corners for _, corners in self.faces()])
        return float(np.linalg.norm(points - self.camera.position, axis=1).max())
