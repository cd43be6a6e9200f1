"""What a foggy picture is made of at any extinction and asymmetry, from pictures of a few trial fogs."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

#: Less of the clear radiance than this survives nothing that a photograph tells; its logarithm stays finite.
LEAST = 1e-12


@dataclass(frozen=True)
class Response:
    """R T and V of each light, of even grey fog that absorbs nothing, at the nodes of a grid.

    extinctions (n,) [1/m] and asymmetries (m,), both rising. paths (n, N, 3) [m]: -ln(T) / extinction, the length of fog that
    what survives has come through, which hardly changes with the extinction. glows (n, m, L, N, 3): ln(V / extinction).
    clear (N, 3): R, linear. Between nodes all are cubic in ln(extinction) and in asymmetry.
    """

    extinctions: np.ndarray
    asymmetries: np.ndarray
    clear: np.ndarray
    paths: np.ndarray
    glows: np.ndarray

    @classmethod
    def of(cls, extinctions, asymmetries, clear: np.ndarray, surviving: np.ndarray, glows: np.ndarray) -> Response:
        """From R (N, 3), R T (n, N, 3), and V (n, m, L, N, 3) of each light at its strength."""
        extinctions, clear = np.asarray(extinctions, float), np.maximum(clear, 0).astype(np.float32)
        along = extinctions[:, None, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(clear > 0, surviving / clear, 1.0)
        paths = -np.log(np.clip(ratio, LEAST, 1)) / along
        logarithms = np.log(np.maximum(glows, 1e-30) / along[:, None, None])
        return cls(extinctions, np.asarray(asymmetries, float), clear, paths.astype(np.float32), logarithms.astype(np.float32))

    @property
    def lights(self) -> int:
        return self.glows.shape[2]

    def of_pixels(self, where: np.ndarray) -> Response:
        """The same of some pixels, (N,) bool."""
        return replace(self, clear=self.clear[where], paths=self.paths[:, where], glows=self.glows[:, :, :, where])

    def at(self, log_extinction: float, asymmetry: float) -> np.ndarray:
        """R T and, after it, V of each light: (1 + L, N, 3), at albedo 1."""
        extinction = np.exp(log_extinction)
        near, along = _cubic(np.log(self.extinctions), log_extinction)
        beside, across = _cubic(self.asymmetries, asymmetry)
        path = sum(weight * one for weight, one in zip(along, self.paths[near]))
        glow = sum(np.float32(a * b) * self.glows[k, m] for a, k in zip(along, range(*near.indices(len(self.extinctions))))
                   for b, m in zip(across, range(*beside.indices(len(self.asymmetries)))))
        surviving = self.clear * np.exp(-extinction * np.maximum(path, 0))
        return np.concatenate([surviving[None], np.float32(extinction) * np.exp(glow)])


def _cubic(nodes: np.ndarray, x: float) -> tuple[slice, np.ndarray]:
    """Of the nodes, the (at most) four nearest round x, and their weights (float32) in the polynomial through them."""
    x = float(np.clip(x, nodes[0], nodes[-1]))
    count = min(4, len(nodes))
    first = int(np.clip(np.searchsorted(nodes, x) - 2, 0, len(nodes) - count))
    near = nodes[first:first + count]
    weights = [np.prod([(x - other) / (node - other) for other in near if other != node]) for node in near]
    return slice(first, first + count), np.asarray(weights, np.float32)
