"""Many equal lamps: rows of street lights, the lit windows of a far shore."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from pipeline.physics import bulbs
from pipeline.plugins.annotations import Position
from pipeline.plugins.base import Colour, Light, Reaching, mistake, parameter


class Lamps(Light):
    """Bulbs of one common intensity, each irradiance intensity * weight / (d^2 + radius^2) at distance d.

    Their glow is an airlight integral, fine near each lamp and coarse elsewhere, so that hundreds are
    affordable; `shadowed` of them, the strongest, get shadows from what stands in the photograph.
    """

    type: Literal["lamps"] = "lamps"
    strength_name = "intensity"
    on_few_rays = True
    rendered = "never"
    positions: Annotated[list[Position], Field(min_length=1, max_length=5000)] = parameter(
        description="where each is")
    weights: Annotated[list[Annotated[float, Field(ge=0, le=1e6)]], Field(min_length=1)] | None = parameter(
        None, "1", description="of each against `intensity`; all 1 when left out")
    intensity: Colour | None = parameter(None, "photo unit * m^2",
                                         description="of a lamp of weight 1; estimated when left out")
    radius: float = parameter(0.1, "m", ge=1e-6, le=1e5, description="of each; bounds the light close to it")
    shadowed: int = parameter(
        8, "1", ge=0, le=64, description="so many of them, the strongest, throw shadows into the fog")

    @model_validator(mode="after")
    def _a_weight_each(self):
        if self.weights is not None and len(self.weights) != len(self.positions):
            raise mistake(f"{len(self.weights)} weights for {len(self.positions)} positions",
                          "give one weight a position, or none at all", at=("weights",))
        return self

    def placed(self, name, world):
        positions = [p.placed(f"{name}.positions[{i}]", world) for i, p in enumerate(self.positions)]
        return self.model_copy(update={"positions": positions})

    @property
    def points(self) -> np.ndarray:
        """(n, 3) [m], of placed lamps."""
        return np.array([p.point for p in self.positions], float)

    def shares(self) -> np.ndarray:
        """Weight (n,) of each lamp."""
        return np.ones(len(self.positions)) if self.weights is None else np.asarray(self.weights, float)

    def shaded(self):
        return self.shadowed > 0

    def shaded_part(self, eye):
        if self.shadowed >= len(self.positions):
            return self
        strength = self.shares() / (((self.points - eye) ** 2).sum(-1) + self.radius**2)
        strongest = np.sort(np.argsort(-strength, kind="stable")[: self.shadowed])
        return self.model_copy(update={
            "positions": [self.positions[i] for i in strongest],
            "weights": [float(self.shares()[i]) for i in strongest]})

    def hidden_count(self, medium, eye):
        return int((~bulbs.visible(medium, eye, self.points)).sum())

    def sub_light_count(self):
        return len(self.positions)

    def bulbs(self):
        return self.points, self.radius

    def incident(self, points):
        points = np.asarray(points, float)
        irradiance, weighted = np.zeros(points.shape[:-1]), np.zeros(points.shape[:-1])
        for position, share in zip(self.points, self.shares()):
            squared = ((points - position) ** 2).sum(-1)
            one = share / (squared + self.radius**2)
            irradiance += one
            weighted += one * np.sqrt(squared)
        return irradiance, weighted / np.maximum(irradiance, 1e-300)

    def reaching(self, points):
        points = np.asarray(points, float)
        total, towards = np.zeros(points.shape[:-1]), np.zeros(points.shape)
        for position, share in zip(self.points, self.shares()):
            offset = points - position
            squared = (offset**2).sum(-1)
            one = share / (squared + self.radius**2)
            total += one
            towards += (one / np.maximum(np.sqrt(squared), 1e-12))[..., None] * offset
        length = np.linalg.norm(towards, axis=-1, keepdims=True)
        return Reaching(total, towards / np.maximum(length, 1e-300), self.incident(points)[1])

    def in_scattering(self, medium, eye, directions, depth):
        return bulbs.bulbs(medium, eye, directions, depth, self.points, self.radius, self.shares())

    def arrival(self, medium, points, normals):
        return bulbs.arrival(medium, points, normals, self.points, self.radius, self.shares())

    def statement(self) -> dict[str, Any]:
        return {"bulbs": [{"location": p.point, "weight": float(w)}
                          for p, w in zip(self.positions, self.shares())]}
