"""Banks and wisps: a seeded random field with the spectrum of a scalar stirred by turbulence."""

from __future__ import annotations

import numpy as np
import scipy

#: Largest banks that fit along a horizontal side of the tile.
BANKS_PER_TILE = 4
#: Cells along the shortest wave: trilinear interpolation keeps its height within a few per cent.
CELLS_PER_WAVE = 4
#: Cells that a midpoint step may span: half the shortest wave, which carries a small part of the variance.
CELLS_PER_STEP = 2.0
#: Standard deviations of the field at which clear air ends and the thickest fog begins: a third is clear.
CLEAR_BELOW, FULL_ABOVE = -0.5, 2.0


def banks(shape: tuple[int, int, int], spacing: np.ndarray, scale: np.ndarray, finest: float,
          patchiness: float, seed: int) -> np.ndarray:
    """Relative density (nx, ny, nz) float32, periodic; the mean of every horizontal layer is 1.

    spacing (3,) [m]; scale (3,) [m]: size of the largest banks by axis; finest: shortest wave as a part of
    them. The Gaussian field below has von Karman's spectrum (1 + q^2)^(-11/6), whose small scales follow
    Kolmogorov's law for a passive scalar, cut off smoothly at the shortest wave. Banks are where it is high:
    a smoothstep of it leaves clear air between them. patchiness 0 is even fog, 1 those banks.
    """
    qx, qy = (scipy.fft.fftfreq(n, d) * s for n, d, s in zip(shape[:2], spacing, scale))
    qz = scipy.fft.rfftfreq(shape[2], spacing[2]) * scale[2]
    squared = (qx[:, None, None] ** 2 + qy[:, None] ** 2 + qz**2).astype(np.float32)
    noise = np.random.default_rng(seed).standard_normal(shape, np.float32)
    spectrum = scipy.fft.rfftn(noise)
    spectrum *= (1 + squared) ** np.float32(-11 / 12) * np.exp(np.float32(-(finest**2) / 2) * squared)
    spectrum[0, 0, 0] = 0
    field = scipy.fft.irfftn(spectrum, shape)
    field /= field.std() or 1
    share = np.clip((field - CLEAR_BELOW) / (FULL_ABOVE - CLEAR_BELOW), 0, 1)
    bank = share * share * (3 - 2 * share)
    # layer by layer, so that visibility means the same at every height
    layer = bank.mean(axis=(0, 2), keepdims=True)
    bank = np.where(layer > 0, bank / np.where(layer > 0, layer, 1), 1)
    return (1 + patchiness * (bank - 1)).astype(np.float32)
