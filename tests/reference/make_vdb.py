"""Writes density.vdb and tiles.vdb with OpenVDB itself; run by Debian's python3, with its package python3-openvdb."""

from pathlib import Path

import pyopenvdb

SHAPE = (6, 5, 4)


def ramp(name, corner, shape, background):
    """Every fourth voxel is inactive; the values are those that test_grid_fog.py expects."""
    grid = pyopenvdb.FloatGrid(background)
    grid.name = name
    grid.transform = pyopenvdb.createLinearTransform(voxelSize=0.25)
    accessor = grid.getAccessor()
    for i, j, k in ((i, j, k) for i in range(shape[0]) for j in range(shape[1]) for k in range(shape[2])):
        if (i + j + k) % 4:
            accessor.setValueOn((corner[0] + i, corner[1] + j, corner[2] + k), 0.1 * i + 0.02 * j + 0.004 * k)
    return grid


folder = Path(__file__).parent
# across the borders of blocks of eight, and at negative indices; compressed as OpenVDB does by default
pyopenvdb.write(str(folder / "density.vdb"),
                [ramp("temperature", (0, 0, 0), (3, 3, 3), 20.0), ramp("density", (-11, 5, 102), SHAPE, 0.05)])
# one voxel, and two blocks of eight that are stored as one value each
tiles = pyopenvdb.FloatGrid(0.0)
tiles.name = "density"
tiles.fill((0, 0, 0), (15, 7, 7), 2.0)
tiles.getAccessor().setValueOn((16, 0, 0), 1.0)
tiles.prune()
pyopenvdb.write(str(folder / "tiles.vdb"), [tiles])
