"""Free polygons, for what boxes cannot say."""

from __future__ import annotations

from typing import Literal

from pipeline.plugins.annotations import Outline
from pipeline.plugins.base import Shape, parameter


class Polygon(Shape):
    """A flat piece: a door leaf, a sloping ceiling, a partition. Its one face is called `face`."""

    type: Literal["polygon"] = "polygon"
    outline: Outline = parameter(description="corners on a plane, or in metres")

    def placed(self, name, world):
        placed = self.model_copy(update={"outline": self.outline.placed(name, world)})
        world.add_faces(name, placed)
        return placed

    def faces(self):
        return {"face": self.outline.polygon}
