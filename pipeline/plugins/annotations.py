"""Things a person marks in the photograph, and what they are in the world.

Everything can be given in either of two ways: as pixels on a named plane, or directly in metres.
`placed(...)` turns the first into the second; placed annotations hold world metres only.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from pipeline.errors import InputError
from pipeline.geometry import planes
from pipeline.plugins.base import Finite, Model, Pixel, Vector, World, mistake, parameter

MAX_VERTICES = 200


class Outline(Model):
    """A planar polygon: `on` a plane with `pixels`, or `points` in world metres."""

    on: str | None = parameter(None, description="plane it lies on, as SHAPE.FACE, for example room.ceiling")
    pixels: Annotated[list[Pixel], Field(min_length=3, max_length=MAX_VERTICES)] | None = parameter(
        None, "pixel", description="corners in the photograph, in order round the outline")
    offset: Finite = parameter(
        0.0, "m", description="towards the camera, off the plane: a lamp that hangs below a ceiling")
    points: Annotated[list[Vector], Field(min_length=3, max_length=MAX_VERTICES)] | None = parameter(
        None, "m", description="corners in the world, instead of `on` and `pixels`")

    @model_validator(mode="after")
    def _one_way(self):
        if (self.points is None) == (self.pixels is None):
            raise mistake("both 'pixels' and 'points' are there" if self.points else "no corners",
                          "give either 'on' and 'pixels', or 'points' in metres")
        if (self.pixels is None) != (self.on is None):
            raise mistake("'on' and 'pixels' go together",
                          "give " + ("'on', the plane" if self.on is None else "'pixels'"))
        return self

    def placed(self, name: str, world: World) -> "Outline":
        if self.points is not None:
            points = planes.clean_polygon(np.asarray(self.points, float), name=name)
        else:
            pixels = planes.clean_polygon(np.asarray(self.pixels, float), name=name)
            plane = _moved(world.plane(self.on, name), self.offset, world.camera.position)
            points = plane.seen_at(world.camera, pixels, name=self.on)
        return Outline(points=np.asarray(points).tolist())

    @property
    def polygon(self) -> np.ndarray:
        """(n, 3) world [m], of a placed outline."""
        return np.asarray(self.points, float)


class Position(Model):
    """A point: `pixel` at a `depth` along its ray, `on` a plane or `above` a spot of one, or `point` in metres."""

    pixel: Pixel | None = parameter(None, "pixel")
    depth: Annotated[float, Field(ge=1e-6, le=1e7)] | None = parameter(None, "m", description="along the ray")
    on: str | None = parameter(None, description="plane it lies on, as SHAPE.FACE")
    above: Pixel | None = parameter(
        None, "pixel", description="the spot right below it on the level plane `on`, the ground when left out")
    offset: Finite = parameter(0.0, "m", description="towards the camera, off the plane")
    point: Vector | None = parameter(None, "m", description="instead of the others")

    @model_validator(mode="after")
    def _one_way(self):
        if (self.point is None) == (self.pixel is None):
            raise mistake("both 'pixel' and 'point' are there" if self.point else "no position",
                          "give either 'point' in metres, or 'pixel' with 'depth' or 'on'")
        if self.above is not None and (self.pixel is None or self.depth is not None):
            raise mistake("'above' goes with 'pixel' and without 'depth'", "keep one way to say how far it is")
        if self.pixel is not None and self.above is None and (self.depth is None) == (self.on is None):
            raise mistake("'pixel' needs one of 'depth', 'on' and 'above'", "give the one that is known")
        return self

    def placed(self, name: str, world: World) -> "Position":
        if self.point is not None:
            return self
        camera, pixel = world.camera, np.asarray(self.pixel, float)
        if self.above is not None:
            point = self._above(world.plane(self.on or "ground", name), camera, name)
        elif self.depth is not None:
            point = camera.position + self.depth * camera.directions(pixel)
        else:
            plane = _moved(world.plane(self.on, name), self.offset, camera.position)
            point = plane.seen_at(camera, pixel, name=self.on)
        return Position(point=point.tolist())

    def _above(self, plane: planes.Plane, camera, name: str) -> np.ndarray:
        """The point on the pixel's ray nearest to the upright line over the spot `above`."""
        spot = plane.seen_at(camera, np.asarray(self.above, float), name=self.on or "ground")
        ray = camera.directions(np.asarray(self.pixel, float))
        level = np.array([ray[0], 0.0, ray[2]])
        if np.linalg.norm(level) < 1e-3:
            raise InputError(f"{name}: pixel {self.pixel} looks straight up or down", remedy="give its 'depth' [m]")
        along = ((spot - camera.position) @ level) / (level @ level)
        if along <= 0:
            raise InputError(f"{name}: pixel {self.pixel} is not above {self.above}",
                             remedy="give the spot on the ground right below it")
        return camera.position + along * ray

    @property
    def vector(self) -> np.ndarray:
        """(3,) world [m], of a placed position."""
        return np.asarray(self.point, float)


def _moved(plane: planes.Plane, offset: float, towards: np.ndarray) -> planes.Plane:
    side = 1.0 if plane.distance(towards) >= 0 else -1.0
    return planes.Plane(plane.point + offset * side * plane.normal, plane.normal)


def facing(polygon: np.ndarray, towards: np.ndarray) -> np.ndarray:
    """The polygon with its vertex order such that its normal points to `towards` (3,)."""
    plane = planes.Plane(polygon.mean(0), planes.polygon_normal(polygon))
    return polygon if plane.distance(np.asarray(towards, float)) >= 0 else polygon[::-1].copy()



