"""Koschmieder's law with one airlight taken from the photograph: the formula of Foggy Cityscapes."""

from __future__ import annotations

from typing import Literal

import cv2
import numpy as np

from pipeline.physics.constant_light import constant_light_fog
from pipeline.plugins.baseline import ClearView, Foggy, OtherFog

#: Side [pixel] of the squares whose darkest value counts, and the share of the brightest of those.
PATCH, BRIGHTEST = 15, 1 / 1000


class Koschmieder(OtherFog):
    """Sakaridis et al. 2018 (Foggy Cityscapes): t = exp(-beta d) and one airlight, on sRGB code values as they do.

    The airlight is a pixel of the photograph: of the thousandth that is brightest in the dark channel (He et al. 2011) the
    one of median intensity (Tang et al. 2014). beta is the fog's extinction, the mean of its channels; d the estimated depth.
    """

    type: Literal["koschmieder"] = "koschmieder"
    title = "Koschmieder, one airlight (Foggy Cityscapes)"
    effects = frozenset({"depth", "desaturation", "brightened shadows", "metres"})

    def foggy(self, view: ClearView) -> Foggy:
        codes = view.encoded.astype(np.float64) / 255
        airlight = brightest_of_the_dark_channel(view.encoded) / 255
        beta = -np.log(0.05) / view.visibility
        foggy = constant_light_fog(codes, (beta * view.depth)[..., None], airlight)
        return Foggy(np.round(255 * foggy).astype(np.uint8), {"airlight_srgb": airlight.tolist(), "beta_per_m": float(beta)})


def brightest_of_the_dark_channel(codes: np.ndarray) -> np.ndarray:
    """(3,) of one of the pixels (H, W, 3) uint8."""
    dark = cv2.erode(codes.min(-1), np.ones((PATCH, PATCH), np.uint8)).ravel()
    count = max(1, int(dark.size * BRIGHTEST)) | 1  # odd, so that the median is a pixel's
    brightest = np.argsort(-dark.astype(int), kind="stable")[:count]
    grey = codes.reshape(-1, 3)[brightest] @ [0.299, 0.587, 0.114]
    middle = brightest[np.argsort(grey, kind="stable")[len(grey) // 2]]
    return codes.reshape(-1, 3)[middle].astype(float)
