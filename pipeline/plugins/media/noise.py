"""Noise: banks and wisps of fog."""

from __future__ import annotations

from functools import lru_cache
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from pipeline.physics import noise_field
from pipeline.physics.density_grid import DensityGrid
from pipeline.plugins.base import Finite, Vector, mistake, parameter
from pipeline.plugins.gridded_medium import GriddedMedium

#: Turn [degree] of the tile, by the golden ratio: a ray along a street or a wall does not meet the same bank
#: again and again.
TURN = 31.717
#: Fog with a scale height and no stated top ends where exp(-7) = 0.1 % of its density is left.
SCALE_HEIGHTS = 7.0
#: Uppermost part of a fog with a top, over which it fades, so that no edge is to be seen.
FADING_PART = 0.25
#: Layers a scale height: linear interpolation is then within 0.2 % of the exponential.
LAYERS_PER_SCALE_HEIGHT = 8
FEWEST_LAYERS = 16
MOST_VALUES = 2**24


class Noise(GriddedMedium):
    """Fog in banks that drift with the wind.

    Over a large volume its mean is that of homogeneous fog of the same visibility; where it lies on the
    ground, the mean over a large area at the height `base` is, and falls with height as stated.
    """

    type: Literal["noise"] = "noise"
    scale: float = parameter(10.0, "m", ge=1e-3, le=1e6, description="size of the largest banks")
    stretch: float = parameter(3.0, "1", ge=1, le=100, description="how much wider than high they are")
    detail: int = parameter(3, "1", ge=1, le=5,
                            description="octaves of sizes; one more halves the smallest wisps")
    patchiness: float = parameter(0.8, "1", ge=0, le=1,
                                  description="0 is even fog, 1 leaves clear air between the banks")
    seed: int = parameter(0, "1", ge=0, le=2**32 - 1, description="another number, other banks")
    offset: Vector = parameter([0.0, 0.0, 0.0], "m", description="moves the banks")
    wind: Vector = parameter([0.0, 0.0, 0.0], "m/s", description="moves the banks as `time` goes on")
    time: Finite = parameter(0.0, "s", description="of this picture in a sequence")
    base: Finite = parameter(0.0, "m", description="height of the ground, where the fog lies on one")
    scale_height: Annotated[float, Field(ge=1e-3, le=1e7)] | None = parameter(
        None, "m", description="height over which it falls to 1/e, above `base`; even where left out")
    top_height: Finite | None = parameter(
        None, "m",
        description="height at which the fog ends, its uppermost quarter fading; endless where left out")

    @model_validator(mode="after")
    def _fits(self):
        if self._lies_on_ground():
            if self.top_height is not None and not self.top_height > self.base:
                raise mistake(f"top_height = {self.top_height:g} is not above base = {self.base:g}",
                              "raise 'top_height' [m]", ("top_height",))
            for name in ("offset", "wind"):
                if getattr(self, name)[1] != 0:
                    raise mistake(f"{name} lifts fog off the ground that it lies on",
                                  "give 0 upwards, and move 'base' instead", (name,))
        elif self.base != 0:
            raise mistake("base means nothing for endless fog", "add 'scale_height' or 'top_height'",
                          ("base",))
        shape, _ = self._tile()
        if np.prod(shape, dtype=float) > MOST_VALUES:
            raise mistake(f"so fine a fog would need {' x '.join(map(str, shape))} values",
                          "lower 'detail' or 'stretch', or raise 'scale' or 'scale_height'", ("detail",))
        return self

    def grid(self):
        shape, spacing = self._tile()
        scale = (self.scale, self.scale / self.stretch, self.scale)
        tile = _tile(shape, tuple(spacing), scale, self._finest(), self.patchiness, self.seed,
                     self._ground() if self._lies_on_ground() else None)
        return tile.moved(np.add(self.offset, np.multiply(self.wind, self.time)))

    def _lies_on_ground(self) -> bool:
        return self.scale_height is not None or self.top_height is not None

    def _finest(self) -> float:
        """Shortest wave, as a part of the largest banks."""
        return 0.5 ** (self.detail - 1)

    def _ground(self) -> tuple[float, float, float | None]:
        """Base and top [m], and the scale height [m]."""
        top = self.top_height
        if top is None or (self.scale_height and self.base + SCALE_HEIGHTS * self.scale_height < top):
            top = self.base + SCALE_HEIGHTS * self.scale_height
        return self.base, top, self.scale_height

    def _tile(self) -> tuple[tuple[int, int, int], np.ndarray]:
        """Values by axis, and their spacing [m]. Without a ground the tile repeats upwards, too."""
        across = round(noise_field.BANKS_PER_TILE * noise_field.CELLS_PER_WAVE / self._finest())
        width = noise_field.BANKS_PER_TILE * self.scale / across
        height = width / self.stretch
        if not self._lies_on_ground():
            return (across, across, across), np.array([width, height, width])
        base, top, scale_height = self._ground()
        height = min(height, (top - base) / FEWEST_LAYERS, (scale_height or np.inf) / LAYERS_PER_SCALE_HEIGHT)
        layers = int(np.ceil((top - base) / height))
        # the lowest value, one layer below the base, is 0 like the highest
        return (across, layers + 2, across), np.array([width, (top - base) / layers, width])


@lru_cache(maxsize=4)
def _tile(shape, spacing, scale, finest, patchiness, seed, ground) -> DensityGrid:
    """The unmoved tile; synthesis takes a second, and the parameters that move it are not among these."""
    if ground is None:
        values = noise_field.banks(shape, spacing, scale, finest, patchiness, seed)
        grid = DensityGrid(values, np.zeros(3), np.array(spacing), (True, True, True), 0.0, TURN,
                           noise_field.CELLS_PER_STEP)
        return grid.rounded()
    base, top, scale_height = ground
    layers = shape[1] - 1
    values = np.zeros(shape, np.float32)
    values[:, 1:] = noise_field.banks((shape[0], layers, shape[2]), spacing, scale, finest, patchiness, seed)
    height = np.arange(layers) * spacing[1]
    envelope = np.exp(-height / scale_height) if scale_height else np.ones(layers)
    left = np.clip((top - base - height) / (FADING_PART * (top - base)), 0, 1)
    values[:, 1:] *= (envelope * left * left * (3 - 2 * left))[:, None]
    values[:, -1] = 0
    first = np.array([0.0, base - spacing[1], 0.0])
    return DensityGrid(values, first, np.array(spacing), (True, False, True), 0.0, TURN,
                       noise_field.CELLS_PER_STEP).rounded()
