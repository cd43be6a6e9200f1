"""Render the Cornell room with fog in it, light of all orders: what the composite is held against by eye.

    python scenes/cornell/model/foggy.py [FOG ...]

writes truth/FOG.exr; some minutes a fog. Direct and singly scattered light of the lamp are integrated, the rest (reflected again,
scattered again) is traced (tests/reference) and smoothed within each face, where it varies little. Pixel centres, as
the photograph.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import cv2
import numpy as np

MODEL = Path(__file__).resolve().parent
SCENE = MODEL.parent
sys.path[:0] = [str(SCENE.parents[1]), str(SCENE.parent)]  # so that the script runs from anywhere, uninstalled

import in_fog  # noqa: E402
from tests.reference import path_tracer, quadrature  # noqa: E402
from tests.validation.truth import ROOM, Truth  # noqa: E402

SIZE, SAMPLES, AT_ONCE = 256, 256, 32
#: Standard deviation [pixel] of the smoothing within a face: of what surfaces reflect, of what the fog scatters.
SMOOTH = {"reflected": 3.0, "single and reflected": 6.0, "multiple": 6.0}


def rendered(fog: in_fog.Fog, truth: Truth) -> np.ndarray:
    """(SIZE, SIZE, 3) in the lamp's radiance unit."""
    # grey fogs alone are traced
    absorption, scattering = (float(np.mean(values)) for values in (fog.absorption, fog.scattering))
    traced_fog = path_tracer.Fog(absorption, scattering, fog.asymmetry)
    own = truth._picture(traced_fog.medium()) + truth._shaped(
        quadrature.in_scattering(truth.rays, traced_fog.medium(), ROOM.lamp, truth.occluders))
    rounds = SAMPLES // AT_ONCE
    traced = sum(path_tracer.trace(ROOM, truth.rays, traced_fog, AT_ONCE, seed) for seed in range(rounds)) / rounds
    face = quadrature.cast(ROOM.camera_position, truth.rays.directions, ROOM.polygons)[1].reshape(SIZE, SIZE)
    return own + sum(smoothed(truth._shaped(traced[path_tracer.SHARES.index(share)]), face, sigma)
                     for share, sigma in SMOOTH.items())


def smoothed(values: np.ndarray, face: np.ndarray, sigma: float) -> np.ndarray:
    """Gaussian mean of values (H, W, 3) over pixels of the same face (H, W)."""
    result = np.zeros_like(values)
    for one in np.unique(face):
        mask = (face == one).astype(float)
        weight = cv2.GaussianBlur(mask, (0, 0), sigma)
        mean = cv2.GaussianBlur(values * mask[..., None], (0, 0), sigma) / np.maximum(weight, 1e-12)[..., None]
        result[face == one] = mean[face == one]
    return result


if __name__ == "__main__":
    room = Truth(SIZE)
    for one in in_fog.asked(__doc__, SCENE):
        start = time.monotonic()
        path = in_fog.write_truth(SCENE, one, rendered(one, room), "Cornell room, all orders of scattering")
        print(f"{path}: {time.monotonic() - start:.0f} s", flush=True)
