"""A triangle mesh."""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from pipeline.geometry.meshes import mesh_hits
from pipeline.plugins.base import Shape, Vector, mistake, parameter

Triangle = Annotated[list[Annotated[int, Field(ge=0)]], Field(min_length=3, max_length=3)]


class Mesh(Shape):
    """Triangles over shared vertices, solid from both sides: what stands in for the photograph's depth."""

    type: Literal["mesh"] = "mesh"
    vertices: Annotated[list[Vector], Field(min_length=3, max_length=200_000)] = parameter(unit="m")
    triangles: Annotated[list[Triangle], Field(min_length=1, max_length=400_000)] = parameter(
        unit="1", description="three indices of vertices each, counted from 0")

    @model_validator(mode="after")
    def _indices(self):
        highest = max(max(triangle) for triangle in self.triangles)
        if highest >= len(self.vertices):
            raise mistake(f"a triangle names vertex {highest} of {len(self.vertices)}",
                          f"use 0 to {len(self.vertices) - 1}", at=("triangles",))
        return self

    def placed(self, name, world):
        world.add_faces(name, self)
        return self

    def faces(self):
        """One: the rectangle round all vertices in the plane nearest to them."""
        points = self._arrays[0]
        centre = points.mean(0)
        axes = np.linalg.svd(points - centre, full_matrices=False)[2][:2]
        low, high = ((points - centre) @ axes.T).min(0), ((points - centre) @ axes.T).max(0)
        # a mesh along a line has no width; its rectangle keeps a sliver, so that it has a normal
        high = np.maximum(high, low + 1e-6 * max(float((high - low).max()), 1e-6))
        corners = np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]])
        return {"surface": centre + corners @ axes}

    @cached_property
    def _arrays(self) -> tuple[np.ndarray, np.ndarray]:
        return np.asarray(self.vertices, float), np.asarray(self.triangles)

    def intersect(self, origin, directions):
        distance = mesh_hits(origin, directions, *self._arrays)
        return distance, np.where(np.isfinite(distance), 0, -1)

    def statement(self) -> dict[str, Any]:
        return {"vertices": self.vertices, "triangles": self.triangles}
