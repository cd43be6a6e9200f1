"""The fog of euler-preprocess, which makes foggy data sets from pictures with depth."""

from __future__ import annotations

import logging
from importlib.metadata import version
from typing import Literal

import numpy as np

from pipeline.plugins.baseline import ClearView, Foggy, OtherFog

SEED = 1


class EulerPreprocess(OtherFog):
    """euler-preprocess' uniform model: Koschmieder's law with the scene's visibility and depth.

    Airlight from the sky where the photograph shows some, as is its default; else from the dark channel.
    """

    type: Literal["euler_preprocess"] = "euler_preprocess"
    title = "euler-preprocess, uniform"
    package = "euler_preprocess"
    effects = frozenset({"depth", "desaturation", "brightened shadows", "heterogeneous", "maps out", "metres"})

    def foggy(self, view: ClearView) -> Foggy:
        disabled = logging.root.manager.disable
        logging.disable(logging.WARNING)  # it tells its configuration at each call
        try:
            from euler_preprocess.fog.inference import render_fog_sample

            airlight = "from_sky" if view.sky.any() else "dcp"
            visibility = {"dist": "constant", "value": float(view.visibility)}
            made = render_fog_sample(
                rgb=view.encoded, depth=planar(view.depth, view.intrinsics).astype(np.float32), semantic_segmentation=view.sky,
                intrinsics=view.intrinsics,
                config={"seed": SEED, "airlight": airlight, "selection": {"mode": "fixed", "model": "uniform"},
                        "models": {"uniform": {"visibility_m": visibility}}})
        finally:
            logging.disable(disabled)
        codes = np.round(255 * np.clip(made.rgb, 0, 1)).astype(np.uint8)
        return Foggy(codes, {"version": version("euler-preprocess"), "seed": SEED, "airlight": airlight,
                             "airlight_value": np.asarray(made.airlight, float).ravel().tolist(), "beta_per_m": float(made.beta)})


def planar(depth: np.ndarray, intrinsics: np.ndarray) -> np.ndarray:
    """Depth (H, W) along the optical axis of one along the ray: it takes the former and works out the latter."""
    rows, columns = np.mgrid[:depth.shape[0], :depth.shape[1]]
    across = (columns - intrinsics[0, 2]) / intrinsics[0, 0]
    down = (rows - intrinsics[1, 2]) / intrinsics[1, 1]
    return depth / np.sqrt(1 + across**2 + down**2)
