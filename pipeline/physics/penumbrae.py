"""Beyond the last pixels that a light is seen to reach: there it shines past an edge with a sliver of itself."""

from __future__ import annotations

import cv2
import numpy as np

#: Of the picture's longer side, the width over which what lies at a shadow's edge fades into the shadow.
FADE = 0.02
#: How much farther apart two surface points may lie than an upright surface's pixels, which slanted ones do.
SLANT = 4.0


def carried(ratio: np.ndarray, known: np.ndarray, points: np.ndarray, pixel: np.ndarray) -> np.ndarray:
    """`ratio` (H, W, 3) where `known` (H, W), and near that, on the same surface, a fade from the nearest known value to 1.

    The part of a large light that a point behind an edge still sees is the part that its last lit neighbour sees:
    light from there takes that way, not the one from the light's middle. points (H, W, 3) [m]; pixel (H, W) [m]: what
    one pixel spans there.
    """
    result = np.where(known[..., None], ratio, 1.0)
    if not known.any() or known.all():
        return result
    reach = FADE * max(known.shape)
    away, label = cv2.distanceTransformWithLabels((~known).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5,
                                                  labelType=cv2.DIST_LABEL_PIXEL)
    near = ~known & (away < reach)
    # labels number the known pixels; where each of them lies
    place = np.empty(label.max() + 1, np.int64)
    place[label[known]] = np.flatnonzero(known)
    nearest = place[label[near]]
    apart = np.linalg.norm(points[near] - points.reshape(-1, 3)[nearest], axis=-1)
    share = np.where(apart <= SLANT * away[near] * pixel[near], 1 - away[near] / reach, 0.0)
    # between two exponentials of paths the path is what fades
    result[near] = np.exp(share[..., None] * np.log(np.maximum(ratio.reshape(-1, 3)[nearest], 1e-30)))
    return result
