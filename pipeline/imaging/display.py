"""Linear light and maps as pictures for a screen: exposure, tone, false colour, size, encoding."""

from __future__ import annotations

import base64
from pathlib import Path

import cv2
import numpy as np

from pipeline.imaging.atomic import replacing
from pipeline.imaging.colour import linear_to_srgb

#: Long side [pixel] of the report's pictures: ten of them as JPEG stay below 2 MB.
LONGEST = 900
#: Kinds of photographs whose unit need not be white.
FLOAT_KINDS = (".exr", ".hdr")


def display_exposure(radiance: np.ndarray) -> float:
    """Factor for a float photograph whose unit is not white: its 99th percentile becomes white."""
    bright = float(np.percentile(np.nan_to_num(radiance, posinf=0, neginf=0).max(-1), 99))
    return 1.0 if bright <= 0 or 0.25 <= bright <= 2 else 1 / bright


def displayed(linear: np.ndarray, exposure: float = 1.0) -> np.ndarray:
    """(H, W, 3) uint8 sRGB of linear light (H, W, 3), clipped at white."""
    finite = np.nan_to_num(np.asarray(linear, np.float32), nan=0, posinf=1e30, neginf=0)
    return np.round(np.clip(linear_to_srgb(finite * np.float32(exposure)), 0, 1) * 255).astype(np.uint8)


def tone_factor(linear: np.ndarray) -> float:
    """Two-digit factor that brings nearly all of a map (99.5 %) below white; 1 for a black one."""
    bright = float(np.percentile(linear, 99.5)) or float(np.max(linear))
    return float(f"{1 / bright:.2g}") if 1e-30 < bright < 1e30 else 1.0


def depth_picture(depth: np.ndarray, sky_depth: float | None = None) -> tuple[np.ndarray, float, float, bool]:
    """(H, W, 3) uint8, near dark and far bright, the depths [m] of the two ends, and whether steps are ratios.

    sky_depth [m]: from which on it is open sky, which takes no part in choosing the ends. They are those of ratios
    where the far end is more than twenty times as far as the near one.
    """
    solid = depth[depth < 0.999 * sky_depth] if sky_depth is not None else depth
    near, far = (float(x) for x in np.percentile(solid if solid.size else depth, [1, 99]))
    logarithmic = far > 20 * near > 0
    scale = np.log if logarithmic else np.asarray
    share = np.clip((scale(np.maximum(depth, near)) - scale(near)) / max(float(scale(far) - scale(near)), 1e-12), 0, 1)
    colours = cv2.applyColorMap(np.round(share * 255).astype(np.uint8), cv2.COLORMAP_VIRIDIS)
    return colours[..., ::-1], near, far, logarithmic


def shrunk(image: np.ndarray, longest: int = LONGEST) -> np.ndarray:
    """At most `longest` pixels a side, averaged in the light that `image` holds."""
    scale = longest / max(image.shape[:2])
    if scale >= 1:
        return image
    size = (max(1, round(image.shape[1] * scale)), max(1, round(image.shape[0] * scale)))
    return cv2.resize(np.ascontiguousarray(image), size, interpolation=cv2.INTER_AREA)


def data_uri(image: np.ndarray, quality: int = 88) -> str:
    """An RGB picture (H, W, 3) uint8 written into the page."""
    options = [cv2.IMWRITE_JPEG_QUALITY, quality,  # full colour: thin coloured lines blur otherwise
               cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
    data = cv2.imencode(".jpg", image[..., ::-1], options)[1]
    return "data:image/jpeg;base64," + base64.b64encode(data).decode("ascii")


def write_png(path: Path, image: np.ndarray) -> None:
    data = cv2.imencode(".png", image[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 6])[1]
    with replacing(path) as name:
        name.write_bytes(data)
