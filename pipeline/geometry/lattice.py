"""Points all over an open space, each standing for the cell of a box that it lies in."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy


@dataclass(frozen=True)
class Lattice:
    """points (n, 3) [m] in some of the counts (3,) cells of the box from low to high (3,) [m]."""

    points: np.ndarray
    low: np.ndarray
    high: np.ndarray
    counts: np.ndarray

    def cells(self, places: np.ndarray) -> np.ndarray:
        """Index (...) of the cell that each place (..., 3) [m] lies in, or is nearest to along the axes."""
        i, j, k = (np.clip(((places[..., a] - self.low[a]) * (n / (self.high[a] - self.low[a]))).astype(int), 0, n - 1)
                   for a, n in enumerate(self.counts))
        return (i * self.counts[1] + j) * self.counts[2] + k

    def nearest(self) -> Callable[[np.ndarray], np.ndarray]:
        """Index (...) of the point that stands for each place (..., 3) [m], as a function."""
        owner = self._owners()
        return lambda places: owner[self.cells(places)]

    def _owners(self) -> np.ndarray:
        """For each cell the point in it, else the one nearest to its middle."""
        indices = np.stack(np.unravel_index(np.arange(np.prod(self.counts)), self.counts), 1)
        owner = scipy.spatial.cKDTree(self.points).query(self.low + (indices + 0.5) / self.counts * (self.high - self.low))[1]
        owner[self.cells(self.points)] = np.arange(len(self.points))
        return owner


def lattice(places: np.ndarray, low: np.ndarray, high: np.ndarray, count: int) -> Lattice:
    """In about `count` cells of a box, those of `places` (n, 3) [m] that are nearest to the middle of theirs: no cell that
    none of them lies in has a point."""
    size = np.maximum(high - low, 1e-6)
    counts = np.maximum(1, np.round(size / (np.prod(size) / count) ** (1 / 3))).astype(int)
    places = places[((places >= low) & (places <= high)).all(-1)]
    empty = Lattice(np.zeros((0, 3)), low, low + size, counts)
    cell = empty.cells(places)
    middle = low + (np.stack(np.unravel_index(cell, counts), 1) + 0.5) / counts * size
    order = np.lexsort((((places - middle) ** 2).sum(-1), cell))
    first = np.unique(cell[order], return_index=True)[1]
    return Lattice(places[order][first], low, low + size, counts)
