"""Upright cylinder: a column, a bin, a lamp's foot."""

from __future__ import annotations

from typing import Literal

import numpy as np

from pipeline.plugins.base import Shape, Vector, parameter

FACETS = 8


class Cylinder(Shape):
    """An upright cylinder. Its curved side counts as the face side_0; top and bottom are flat."""

    type: Literal["cylinder"] = "cylinder"
    base: Vector = parameter(unit="m", description="centre of its bottom")
    radius: float = parameter(unit="m", gt=0, le=1e6)
    height: float = parameter(unit="m", gt=0, le=1e6)

    def placed(self, name, world):
        world.add_faces(name, self)
        return self

    def faces(self):
        """The facets round it, on which things can be placed, then top and bottom."""
        angle = 2 * np.pi * np.arange(FACETS) / FACETS
        rim = np.stack([np.cos(angle), np.zeros(FACETS), np.sin(angle)], -1) * self.radius + self.base
        top = rim + [0, self.height, 0]
        after = np.roll(np.arange(FACETS), -1)
        sides = {f"side_{i}": np.stack([rim[i], rim[j], top[j], top[i]]) for i, j in enumerate(after)}
        return {**sides, "top": top, "bottom": rim}

    def intersect(self, origin, directions):
        start, directions = np.subtract(origin, self.base), np.asarray(directions, float)
        hits = [self._side(start, directions, root) for root in (-1, 1)]
        hits += [self._disc(start, directions, height) for height in (self.height, 0.0)]
        distance = np.stack(hits)
        nearest = distance.argmin(0)
        face = np.choose(nearest, [0, 0, FACETS, FACETS + 1])
        return distance.min(0), np.where(np.isfinite(distance.min(0)), face, -1)

    def _side(self, start, directions, root):
        a = directions[..., 0] ** 2 + directions[..., 2] ** 2
        b = directions[..., 0] * start[0] + directions[..., 2] * start[2]
        c = start[0] ** 2 + start[2] ** 2 - self.radius**2
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (-b + root * np.sqrt(b * b - a * c)) / a
            height = start[1] + t * directions[..., 1]
        return np.where((t > 1e-9) & (height >= 0) & (height <= self.height), t, np.inf)

    def _disc(self, start, directions, height):
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (height - start[1]) / directions[..., 1]
            away = np.hypot(start[0] + t * directions[..., 0], start[2] + t * directions[..., 2])
        return np.where((t > 1e-9) & (away <= self.radius), t, np.inf)

    def statement(self):
        return {"top": [self.base[0], self.base[1] + self.height, self.base[2]], "facets": FACETS}
