"""Cuboid proxies of furniture."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import model_validator

from pipeline.errors import InputError
from pipeline.geometry.boxes import AxisBox, fit_cuboid
from pipeline.plugins.base import Finite, Length, Pixel, Shape, Vector, mistake, parameter

AXIS_NAMES = "xyz"


class Cuboid(Shape):
    """A box proxy (Zheng et al. 2012), by its visible corners and the face it stands on.

    Faces bottom, top, left, right, back, front; corners such as front_left_top. Front is towards the viewer.
    """

    type: Literal["cuboid"] = "cuboid"
    stands_on: str | None = parameter(
        None, description="plane it touches: a floor, a wall, a ceiling, another box's top")
    corners: dict[str, Pixel] = parameter({}, "pixel", description="visible corners by name", max_length=8)
    known: dict[Literal["width", "height", "depth"], Length] = parameter(
        {}, "m", description="sizes that the corners leave open")
    yaw: Finite | Literal["fit"] = parameter(0.0, "degree", description="turn about the vertical, or `fit`")
    centre: Vector | None = parameter(None, "m",
                                      description="with `size`, the box itself instead of annotations")
    size: Vector | None = parameter(None, "m")

    @model_validator(mode="after")
    def _one_way(self):
        known = self.centre is not None and self.size is not None
        measured = self.centre is not None or self.size is not None
        annotated = self.stands_on is not None and bool(self.corners)
        both = known and (self.stands_on or self.corners or self.known)
        if known == annotated or measured != known or both:
            raise mistake("neither annotated nor measured, or both",
                          "give either 'stands_on' and 'corners', or 'centre' and 'size' in metres")
        if known and (self.yaw == "fit" or not min(self.size) > 0):
            raise mistake(f"size {self.size} with yaw {self.yaw}",
                          "with 'centre', give sizes above 0 and a yaw in degrees")
        return self

    def placed(self, name, world):
        if self.centre is None:
            plane = world.plane(self.stands_on, name)
            axis = int(np.argmax(np.abs(plane.normal)))
            if abs(plane.normal[axis]) < 0.999:
                raise InputError(f"{name} stands on '{self.stands_on}', which does not face along x, y or z",
                                 remedy="stand it on a face of the room or of a box without yaw")
            # the box lies on the side of the plane on which the camera is
            side = "lower" if world.camera.position[axis] >= plane.point[axis] else "upper"
            fit = fit_cuboid(world.camera, self.corners, (AXIS_NAMES[axis], side, float(plane.point[axis])),
                             yaw=self.yaw, known=dict(self.known), name=name)
            box = fit.box
            world.residuals[name] = {"rms": fit.rms, **fit.residuals}
            world.messages += [f"{name}: {w}" for w in fit.warnings]
            placed = Cuboid(albedo=self.albedo, centre=box.centre.tolist(), size=box.size.tolist(),
                            yaw=box.yaw)
        else:
            placed = self
        world.add_faces(name, placed)
        return placed

    @property
    def box(self) -> AxisBox:
        half = np.asarray(self.size, float) / 2
        turn = AxisBox(np.zeros(3), np.ones(3), float(self.yaw)).world_from_box
        centre = turn.T @ np.asarray(self.centre, float)
        return AxisBox(centre - half, centre + half, float(self.yaw))

    def faces(self):
        return self.box.faces()
