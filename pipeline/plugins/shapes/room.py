"""The room as a box, seen from inside."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from pipeline.errors import InputError
from pipeline.geometry.boxes import AxisBox, fit_room
from pipeline.plugins.base import Finite, Pixel, Shape, Vector, mistake, parameter

WALLS = Literal["left", "right", "back", "front", "ceiling"]


class Room(Shape):
    """Floor (y = 0), ceiling, four walls along the axes; faces floor, ceiling, left, right, back, front."""

    type: Literal["room"] = "room"
    casts_shadow: ClassVar[bool] = False
    corners: dict[str, Pixel] = parameter(
        {}, "pixel", description="corners by name, such as back_left_floor, front_right_ceiling",
        max_length=8)
    edges: dict[str, Annotated[list[Pixel], Field(min_length=2, max_length=2)]] = parameter(
        {}, "pixel",
        description="two points along an edge by name, such as floor_back, ceiling_left, back_left",
        max_length=12)
    known: dict[WALLS, Finite] = parameter({}, "m", description="coordinates of walls that nothing shows")
    behind: float = parameter(1.0, "m", ge=1e-6, le=1e6,
                              description="distance of an unseen front wall behind the camera")
    lower: Vector | None = parameter(None, "m",
                                     description="with `upper`, the room itself instead of annotations")
    upper: Vector | None = parameter(None, "m")

    @model_validator(mode="after")
    def _one_way(self):
        if (self.lower is None) != (self.upper is None):
            raise mistake("only one of 'lower' and 'upper' is there", "give both, in metres")
        if self.lower is not None and (self.corners or self.edges or self.known):
            raise mistake("both annotated and measured",
                          "keep 'lower' and 'upper', or 'corners', 'edges' and 'known'")
        return self

    def placed(self, name, world):
        if self.lower is None or self.upper is None:
            fit = fit_room(world.camera, self.corners, self.edges, dict(self.known), behind=self.behind)
            box = fit.box
            world.residuals[name] = {"rms": fit.rms, **fit.residuals}
            world.messages += [f"{name}: {w}" for w in fit.warnings]
        else:
            box = AxisBox(np.asarray(self.lower, float), np.asarray(self.upper, float))
            if not (box.size > 0).all():
                raise InputError(f"{name}: lower {self.lower} is not below upper {self.upper} in every axis",
                                 remedy="swap the coordinates that are the wrong way round")
        placed = Room(albedo=self.albedo, lower=box.lower.tolist(), upper=box.upper.tolist())
        if not box.contains(world.camera.position):
            world.messages.append(f"{name}: the camera stands outside the room")
        world.add_faces(name, placed)
        return placed

    def faces(self):
        return AxisBox(np.asarray(self.lower, float), np.asarray(self.upper, float)).faces(room=True)

