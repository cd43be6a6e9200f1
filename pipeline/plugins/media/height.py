"""Fog that grows thinner with height."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from pydantic import model_validator

from pipeline.plugins.base import Finite, mistake, parameter
from pipeline.plugins.layered_medium import LayeredMedium

#: What is thinner than exp(-16) = 1e-7 of the ground's fog POV-Ray takes as clear.
SCALE_HEIGHTS = 16.0
NODES = 240
#: Midpoints a scale height: the exponential's integral is then within (1/6)^2/24 = 0.1 %.
STEPS_PER_SCALE_HEIGHT = 6
STEPS_TO_THE_TOP = 80


class Height(LayeredMedium):
    """Exponential fog over the ground: even up to `base`, then falling to 1/e every `scale_height`.

    The visibility holds at and below `base`. Without a `top` sun and sky reach the fog as the photograph shows
    them; with one they are dimmed on their way down through it.
    """

    type: Literal["height"] = "height"
    base: Finite = parameter(0.0, "m", description="height up to which it is as dense as stated")
    scale_height: float = parameter(unit="m", ge=1e-3, le=1e7,
                                    description="height over which it falls to 1/e, above `base`")
    top_height: Finite | None = parameter(None, "m", description="height at which it ends; endless where left out")

    @model_validator(mode="after")
    def _top_above_base(self):
        if self.top_height is not None and not self.top_height > self.base:
            raise mistake(f"top_height = {self.top_height:g} is not above base = {self.base:g}",
                          "raise 'top_height' [m]", at=("top_height",))
        return self

    def top(self):
        return self.top_height

    def render_step(self):
        step = self.scale_height / STEPS_PER_SCALE_HEIGHT
        # the density jumps at a top
        return step if self.top_height is None else min(step, (self.top_height - self.base) / STEPS_TO_THE_TOP)

    def bends(self):
        return [h for h in (self.base + self.scale_height * k for k in (0, 1, 2, 4, 8, SCALE_HEIGHTS))
                if self.top_height is None or h < self.top_height] + (
            [] if self.top_height is None else [self.top_height])

    def level_density(self, height):
        density = np.exp(-np.maximum(height - self.base, 0.0) / self.scale_height)
        return density if self.top_height is None else np.where(height < self.top_height, density, 0.0)

    def column(self, low, high):
        top = np.inf if self.top_height is None else self.top_height
        even = np.minimum(high, self.base) - np.minimum(low, self.base)
        first, last = np.clip(low, self.base, top), np.clip(high, self.base, top)
        # expm1 keeps the digits of a rise that is small beside the scale height
        thinning = (np.exp(-(first - self.base) / self.scale_height)
                    * -np.expm1(-(last - first) / self.scale_height) * self.scale_height)
        return even + thinning

    def statement(self) -> dict[str, Any]:
        reach = SCALE_HEIGHTS * self.scale_height
        if self.top_height is not None:
            reach = min(reach, self.top_height - self.base)
        heights = self.base + reach * np.linspace(0, 1, NODES)
        nodes = [[float(h), float(np.exp(-(h - self.base) / self.scale_height))] for h in heights]
        return {"nodes": [*nodes, [nodes[-1][0], 0.0]], "lowest_density": 1.0,
                "end": nodes[-1][0] if self.top_height is not None else 1e12}
