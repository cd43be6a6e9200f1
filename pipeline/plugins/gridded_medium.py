"""What fogs have in common whose density stands on a grid."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np

from pipeline.physics import light_volume
from pipeline.physics.density_grid import DensityGrid, density_file
from pipeline.plugins.media_base import DenseMedium

#: So few points ask each for its own integral; for more of them a table is worked out first.
FEW_POINTS = 2**15


class GriddedMedium(DenseMedium):
    """Fog whose relative density is a `DensityGrid`; POV-Ray reads the same values from a file."""

    def grid(self) -> DensityGrid:
        """The values where they stand in the world, rounded to what the file holds."""
        raise NotImplementedError(type(self).__name__)

    def density(self, points):
        return self.grid().density(points)

    def density_path(self, origin, points):
        return self.grid().path(origin, points)

    def density_along(self, origin, directions, distances):
        return self.grid().path_along(origin, directions, distances)

    def daylight_path(self, points, direction):
        if self.top() is None:
            return super().daylight_path(points, direction)
        return self.grid().path_out(points, direction)

    def paths_from(self, origin, reach, count):
        if count < FEW_POINTS:
            return super().paths_from(origin, reach, count)
        return light_volume.lamp_paths(self.grid(), origin, reach)

    def daylight(self, direction, count):
        if self.top() is None or count < FEW_POINTS:
            return super().daylight(direction, count)
        return light_volume.sun_paths(self.grid(), direction)

    def skylight(self, extinctions, count):
        if self.top() is None:
            return super().skylight(extinctions, count)
        return light_volume.sky_paths(self.grid(), extinctions)

    def top(self):
        grid = self.grid()
        if grid.periodic[1] or grid.outside > 0:
            return None
        return float(grid.first[1] + grid.spacing[1] * (grid.values.shape[1] - 1))

    def longest_step(self):
        grid = self.grid()
        return float(grid.spacing.min() * grid.cells_per_step)

    def side_files(self):
        data = density_file(self.grid())
        return {self._file_name(data): data}

    def statement(self) -> dict[str, Any]:
        grid = self.grid()
        lowest, highest = grid.bounds
        return {"grid": {
            "file": self._file_name(density_file(grid)), "first": grid.first.tolist(), "yaw": float(grid.yaw),
            "size": (grid.spacing * grid.values.shape).tolist(), "outside": float(grid.outside),
            "repeated": [axis for axis, periodic in zip("xyz", grid.periodic) if periodic],
            "lowest": lowest, "highest": highest, "first_level": grid.first_level}}

    def _file_name(self, data: bytes) -> str:
        """Told by its contents, so that a `.pov` file's text says all that its picture depends on."""
        return f"{self.type_name()}_{hashlib.sha256(data).hexdigest()[:16]}.df3"
