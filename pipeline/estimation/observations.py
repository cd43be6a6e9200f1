"""What is known at each pixel before intensities are estimated, and which pixels can be used."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy import ndimage

from pipeline.errors import InputError

DARKEST = 0.004  # of the photograph's 99th percentile: below it, 8-bit sRGB has under two levels


@dataclass(frozen=True)
class EstimationMaps:
    """What is known at each pixel.

    photograph: (H, W, 3) linear. basis: (L, H, W, 3) irradiance/pi of each light at unit intensity; None
    as long as nothing is rendered, since the lights may be rendered at the reduced size.
    surface: (H, W) int32 face index, -1 none. emitter: (H, W) int32 light index, -1 none.
    clipped: (H, W) bool. annotated: pairs of mask (H, W) bool and albedo (3,).
    """

    photograph: np.ndarray
    basis: np.ndarray | None
    surface: np.ndarray
    emitter: np.ndarray
    clipped: np.ndarray
    annotated: tuple[tuple[np.ndarray, np.ndarray], ...] = ()


def reduced_size(width: int, height: int, max_side: int) -> tuple[int, int]:
    """Width and height of maps of these, at no more than `max_side` pixels a side."""
    scale = min(1.0, max_side / max(height, width))
    return max(1, round(width * scale)), max(1, round(height * scale))


def reduce_for_estimation(maps: EstimationMaps, max_side: int = 160) -> EstimationMaps:
    """The same maps at no more than `max_side` pixels a side.

    Radiance is averaged over area; a reduced pixel is clipped if any of its pixels is, shows an
    emitter if any does, is annotated if more than half is; faces are taken from the nearest pixel.
    """
    height, width = maps.surface.shape
    size = reduced_size(width, height, max_side)
    if size == (width, height):
        return maps

    def mean(image):
        return cv2.resize(np.ascontiguousarray(image, np.float32), size, interpolation=cv2.INTER_AREA)

    def nearest(labels):
        return cv2.resize(labels.astype(np.int32), size, interpolation=cv2.INTER_NEAREST_EXACT)

    emitter = nearest(maps.emitter)
    for light in np.unique(maps.emitter[maps.emitter >= 0]):
        emitter[mean(maps.emitter == light) > 0] = light
    return EstimationMaps(
        photograph=mean(maps.photograph).astype(float),
        basis=None if maps.basis is None else np.stack([mean(light) for light in maps.basis]).astype(float),
        surface=nearest(maps.surface),
        emitter=emitter,
        clipped=mean(maps.clipped) > 0,
        annotated=tuple((mean(mask) > 0.5, albedo) for mask, albedo in maps.annotated),
    )


def check_input(maps, names, given, measured, at_least) -> None:
    """Raises InputError for a person's mistakes, ValueError for maps that do not belong together."""
    shape = maps.surface.shape
    if not names:
        raise InputError("the scene has no lights", remedy="annotate at least one lamp, window or sun patch")
    if maps.basis.shape != (len(names), *shape, 3) or maps.photograph.shape != (*shape, 3):
        raise ValueError(f"basis {maps.basis.shape}, photograph {maps.photograph.shape}, surface {shape}")
    if not np.isfinite(maps.basis).all() or (maps.basis < 0).any():
        raise ValueError("a basis render holds values that are negative or not finite")
    for what, known in (("intensity", given), ("radiance", measured), ("least intensity", at_least)):
        for light, value in known.items():
            if value.shape != (3,) or not np.isfinite(value).all() or (value < 0).any():
                raise InputError(
                    f"{what} {value.tolist()} of light '{names[light]}' is no colour",
                    remedy="give three finite numbers, none below 0",
                )
    for _, albedo in maps.annotated:
        albedo = np.asarray(albedo, float)
        if albedo.shape != (3,) or not ((albedo > 0) & (albedo <= 1)).all():
            raise InputError(
                f"annotated albedo {albedo.tolist()}", remedy="give three numbers above 0, at most 1"
            )


def without_invalid(maps: EstimationMaps) -> EstimationMaps:
    """The maps with pixels that are not numbers counted as clipped, and negative radiance as none."""
    finite = np.isfinite(maps.photograph).all(-1)
    photograph = np.where(finite[..., None], np.maximum(np.nan_to_num(maps.photograph), 0), 0)
    return replace(maps, photograph=photograph, clipped=maps.clipped | ~finite)


def usable_pixels(maps: EstimationMaps) -> np.ndarray:
    """Pixels that show a lit, unclipped surface, (h, w); the bloom beside an emitter is left out."""
    beside_emitter = ndimage.binary_dilation(maps.emitter >= 0)
    usable = ~maps.clipped & ~beside_emitter & (maps.surface >= 0) & (maps.basis.sum(0) > 0).all(-1)
    lightness = maps.photograph.mean(-1)
    if not usable.any():
        return usable
    return usable & (lightness > DARKEST * np.percentile(lightness[usable], 99))
