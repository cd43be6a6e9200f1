"""Grid: fog whose density a file gives."""

from __future__ import annotations

import io
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, PrivateAttr, StringConstraints, model_validator

from pipeline.errors import InputError
from pipeline.physics.density_grid import DensityGrid, bounded, read_density_file
from pipeline.physics.vdb_grid import read_vdb
from pipeline.plugins.base import Finite, Vector, mistake, parameter
from pipeline.plugins.gridded_medium import GriddedMedium

MOST_VALUES = 2**25
#: A df3 file counts them in 16 bits; one more on either side holds the density outside.
MOST_ALONG_AXIS = 65533
AXES = {"xyz": (0, 1, 2), "zyx": (2, 1, 0), "xzy": (0, 2, 1)}
Size = Annotated[list[Annotated[float, Field(ge=1e-6, le=1e7)]], Field(min_length=3, max_length=3)]


class Grid(GriddedMedium):
    """Fog in a box, from a file of relative densities.

    Each value stands at the centre of its cell and density is trilinear between them; it fades to `outside`
    over the width of one cell, the middle of which is the box's face, so that the fog's amount is kept.
    """

    type: Literal["grid"] = "grid"
    file: Annotated[str, StringConstraints(min_length=1, max_length=200)] = parameter(
        description="in the scene's folder: NumPy .npy (3D, numbers), POV-Ray .df3 or OpenVDB .vdb (its grid "
                    "'density', else its first of floats: the box of active voxels; its own transform is not used)")
    lower: Vector | None = parameter(None, "m", description="corner of the box, with `upper`")
    upper: Vector | None = parameter(None, "m", description="opposite corner")
    centre: Vector | None = parameter(None, "m", description="of the box, with `size`, instead of corners")
    size: Size | None = parameter(None, "m", description="of the box along its x, y (up) and z")
    yaw: Finite = parameter(0.0, "degree",
                            description="turn of the box about the vertical through its centre")
    axes: Literal["xyz", "zyx", "xzy"] = parameter(
        "xyz", description="what the file's indices run along, the first index first; y is up")
    normalise: Literal["mean", "max", "none"] = parameter(
        "mean", description="value that stands for relative density 1: the mean of all, the largest, or 1")
    density_scale: float = parameter(1.0, "1", ge=0, le=1e6, description="multiplies the density in the box")
    outside: float = parameter(0.0, "1", ge=0, le=1e6, description="relative density round the box")
    _grid: DensityGrid | None = PrivateAttr(None)

    @model_validator(mode="after")
    def _one_box(self):
        given = [value is not None for value in (self.lower, self.upper, self.centre, self.size)]
        if given not in ([True, True, False, False], [False, False, True, True]):
            raise mistake("the box is stated in no way, or in two",
                          "give either 'lower' and 'upper', or 'centre' and 'size'")
        if self.lower is not None and not all(a < b for a, b in zip(self.lower, self.upper)):
            raise mistake(f"upper = {self.upper} is not above lower = {self.lower} in x, y and z",
                          "swap the values that are", ("upper",))
        if not self.file.lower().endswith((".npy", ".df3", ".vdb")):
            raise mistake(f"file = '{self.file}'", "name a .npy, .df3 or .vdb file", ("file",))
        return self

    def files(self):
        return [self.file]

    def loaded(self, read):
        values = self._values(read(self.file)).transpose(AXES[self.axes])
        unit = {"mean": values.mean(), "max": values.max(), "none": 1.0}[self.normalise]
        if not unit > 0:
            raise InputError(f"its {self.normalise} is 0: no density to normalise by", place=self.file,
                             remedy="give a file with fog in it, or 'normalise: none'")
        size = np.array(self.size if self.size else np.subtract(self.upper, self.lower), float)
        centre = np.array(self.centre if self.centre else np.add(self.upper, self.lower) / 2, float)
        cosine, sine = np.cos(np.radians(self.yaw)), np.sin(np.radians(self.yaw))
        x, y, z = -size / 2
        corner = centre + [x * cosine + z * sine, y, -x * sine + z * cosine]
        copy = self.model_copy()
        density = values / unit * self.density_scale
        copy._grid = bounded(density, corner, size, self.outside, self.yaw).rounded()
        return copy

    def grid(self):
        if self._grid is None:
            raise RuntimeError(f"{self.file} was not loaded")
        return self._grid

    def _values(self, data: bytes) -> np.ndarray:
        """Densities (n, n, n) as the file's indices run."""
        try:
            if self.file.lower().endswith(".df3"):
                values = read_density_file(data)
            elif self.file.lower().endswith(".vdb"):
                values = read_vdb(data, MOST_VALUES)
            else:
                values = np.lib.format.read_array(io.BytesIO(data), allow_pickle=False)
        except Exception as error:  # readers of other people's formats fail in any way, for example with TokenError
            reason = next(iter(str(error).splitlines()), type(error).__name__)
            raise InputError(f"cannot be read ({reason})", place=self.file,
                             remedy="save it with numpy.save, or give a df3 file") from None
        if values.ndim != 3 or values.dtype.kind not in "fiub" or not values.size:
            raise InputError(f"holds {'x'.join(map(str, values.shape))} values of type {values.dtype}",
                             place=self.file, remedy="give three axes of real numbers")
        if values.size > MOST_VALUES or max(values.shape) > MOST_ALONG_AXIS:
            raise InputError(f"holds {'x'.join(map(str, values.shape))} values", place=self.file,
                             remedy=f"keep them below {MOST_VALUES}, for example by averaging eight into one;"
                                    " POV-Ray's own format sets this limit")
        values = values.astype(np.float32)
        if not np.isfinite(values).all() or values.min() < 0:
            raise InputError("holds densities that are negative or not finite", place=self.file,
                             remedy="give densities of 0 and more")
        return values
