"""Relative density of fog from OpenVDB files, made dense."""

from __future__ import annotations

import math

import numpy as np
import tinyvdb


def read_vdb(data: bytes, most_values: int) -> np.ndarray:
    """Values (nx, ny, nz) float32 of the grid `density`, or else of the first grid of floats, along its indices.

    The array is the bounding box of the active voxels; the inactive ones in it have the grid's background.
    The file's transform is not used. ValueError where the file is damaged, has no such grid, holds more than
    most_values or has active tiles (blocks stored as one value): tinyvdb 0.9 leaves those out without a word.
    That library believes a file's numbers of grids and of tiles: a damaged one can cost seconds and gigabytes.
    """
    try:
        file = tinyvdb.from_bytes(data)
        file.read_grids()
        grid = _chosen(file)
        if grid.active_voxel_count() > most_values:
            raise ValueError(f"more than {most_values} voxels are active")
        if _has_active_tiles(grid):
            raise ValueError("it has active tiles; voxelise them before it is written")
        sparse, background = grid.to_sparse(), grid.float_background()
    except (tinyvdb.VDBError, UnicodeDecodeError, SystemError) as error:  # the last where a node is out of range
        raise ValueError(f"no OpenVDB file, or a damaged one: {str(error)!r}") from None
    places = np.frombuffer(sparse["coords"], np.int32).reshape(-1, 3)
    if not len(places):
        raise ValueError("no voxel of its grid is active")
    lowest = places.min(0)
    shape = (places.max(0).astype(np.int64) - lowest + 1).tolist()
    if math.prod(shape) > most_values:
        raise ValueError(f"its active voxels span {' x '.join(map(str, shape))}, more than {most_values} values")
    values = np.full(shape, background, np.float32)
    values[tuple((places - lowest).T)] = np.frombuffer(sparse["values"], np.float32)
    return values


def _chosen(file: tinyvdb.VDBFile) -> tinyvdb.VDBGrid:
    kinds = [file.grid_type_name(i) for i in range(file.grid_count)]
    names = [file.grid_name(i) for i in range(file.grid_count)]
    floats = [i for i, kind in enumerate(kinds) if kind.startswith("Tree_float")]
    if "density" in names and names.index("density") not in floats:
        raise ValueError(f"its grid 'density' is of type {kinds[names.index('density')]!r}, not of floats")
    if not floats:
        raise ValueError(f"it has no grid of floats, only {', '.join(map(repr, kinds)) or 'none at all'}")
    return file.grid(next((i for i in floats if names[i] == "density"), floats[0]))


def _has_active_tiles(grid: tinyvdb.VDBGrid) -> bool:
    counted = grid.metadata.get("file_voxel_count")
    if counted is not None and counted != grid.active_voxel_count():
        return True
    nodes = (grid.tree.node(i) for i in range(grid.tree.num_nodes))
    return any(node.type == "internal" and node.active_voxel_count for node in nodes)
