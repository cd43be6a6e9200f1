"""Small lamps in the photograph: their image and the glare round it, told apart from what is behind them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.geometry.camera import Camera
from pipeline.geometry.visibility import COINCIDENT

#: A lamp's image is at least so wide [pixel].
LEAST_RADIUS = 1.0
#: The lens spreads it over at most this share of the photograph's longer side.
REACH = 0.012
#: Part of the pixels round that which are darker than what is taken as the background.
BACKGROUND = 0.5


@dataclass(frozen=True)
class Glare:
    """light (H, W): index of the lamp whose light a pixel shows, -1 for none; distance (H, W) [m] of that lamp, and how
    much of the pixel's radiance is its: radiance (H, W, 3)."""

    light: np.ndarray
    distance: np.ndarray
    radiance: np.ndarray


def glare(camera: Camera, lights: dict, depth: np.ndarray, photograph: np.ndarray) -> Glare:
    """What of a linear photograph (H, W, 3) is the image of placed lights' bulbs, which nothing at depth (H, W) [m] hides.

    Only the fog before the bulb dims that, not what lies before the wall or the sky behind it. It is what a pixel near
    the bulb is brighter by than its surroundings, and counts less towards its rim.
    """
    found = Glare(np.full(depth.shape, -1, np.int32), np.zeros(depth.shape), np.zeros(photograph.shape))
    size = np.array(depth.shape[::-1])
    for index, light in enumerate(lights.values()):
        positions, radius = light.bulbs()
        pixels, planar = camera.project(positions)
        for pixel, distance, z in zip(pixels, np.linalg.norm(positions - camera.position, axis=-1), planar):
            if z <= radius:
                continue
            core = max(LEAST_RADIUS, camera.focal_length * radius / z)
            reach = core + REACH * size.max()
            low = np.clip(np.floor(pixel - 1.5 * reach), 0, size).astype(int)
            high = np.clip(np.ceil(pixel + 1.5 * reach), 0, size).astype(int)
            if (high <= low).any():
                continue
            part = np.s_[low[1]:high[1], low[0]:high[0]]
            rows, columns = np.mgrid[part]
            off = np.hypot(columns + 0.5 - pixel[0], rows + 0.5 - pixel[1])
            shown = (off <= reach) & (distance <= depth[part] * (1 + COINCIDENT))
            ring = off > reach
            background = np.quantile(photograph[part][ring], BACKGROUND, axis=0) if ring.any() else np.zeros(3)
            fading = np.clip((reach - off) / (reach - core), 0, 1) ** 0.5
            radiance = np.maximum(photograph[part] - background, 0) * fading[..., None]
            brighter = shown & (radiance.sum(-1) > found.radiance[part].sum(-1))
            found.light[part][brighter] = index
            found.distance[part][brighter] = distance
            found.radiance[part][brighter] = radiance[brighter]
    return found
