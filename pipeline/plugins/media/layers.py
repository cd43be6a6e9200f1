"""Fog in level layers."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from pipeline.plugins.base import Finite, Model, mistake, parameter
from pipeline.plugins.layered_medium import LayeredMedium


#: Midpoints through the thinnest layer: where it begins and ends is then within a thirty-second of it.
STEPS_PER_LAYER = 16


class Layer(Model):
    """An even slab of fog."""

    lower: Finite = parameter(unit="m", description="height at which it begins")
    upper: Finite = parameter(unit="m", description="height at which it ends")
    density: float = parameter(1.0, "1", ge=0, le=1e6, allow_inf_nan=False,
                               description="relative to the fog's coefficients")

    @model_validator(mode="after")
    def _upwards(self):
        if not self.lower < self.upper:
            raise mistake(f"lower = {self.lower:g} is not below upper = {self.upper:g}", "exchange them")
        return self


class Layers(LayeredMedium):
    """Level slabs, clear air between them; where they overlap they add up. Daylight is dimmed from the top down."""

    type: Literal["layers"] = "layers"
    layers: Annotated[list[Layer], Field(min_length=1, max_length=60)] = parameter(description="in any order")

    def top(self):
        return max(layer.upper for layer in self.layers)

    def render_step(self):
        return min(layer.upper - layer.lower for layer in self.layers) / STEPS_PER_LAYER

    def bends(self):
        return sorted({border for layer in self.layers for border in (layer.lower, layer.upper)})

    def level_density(self, height):
        height = np.asarray(height, float)
        return sum(layer.density * ((height >= layer.lower) & (height < layer.upper)) for layer in self.layers)

    def column(self, low, high):
        return sum(layer.density * (np.clip(high, layer.lower, layer.upper) - np.clip(low, layer.lower, layer.upper))
                   for layer in self.layers)

    def statement(self) -> dict[str, Any]:
        nodes: list[list[float]] = []
        before = 0.0
        for border in self.bends():
            after = float(self.level_density(np.array(border)))
            nodes += [[border, before], [border, after]]
            before = after
        return {"nodes": nodes, "lowest_density": 0.0}
