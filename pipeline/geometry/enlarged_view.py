"""What each pixel of a large photograph shows, from what was found at a smaller size.

Within one face the inverse of planar depth is linear in the photograph's plane: what lies between pixels of one face
follows from these. Only along edges rays are cast.
"""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.geometry.camera import Camera
from pipeline.geometry.visibility import seen_along

#: Rays cast at once.
_RAYS = 500_000


class EnlargedView:
    """Depth, face and light as of `visibility.visible`, at the size of `camera`, some rows at a time.

    small: the same camera at the size at which depth (h, w) [m], inf past everything, face and emitter (h, w) were found.
    """

    def __init__(self, camera: Camera, small: Camera, depth: np.ndarray, face: np.ndarray, emitter: np.ndarray,
                 shapes: dict, lights: dict):
        self.camera, self.small, self.shapes, self.lights = camera, small, shapes, lights
        self.face, self.emitter = face.astype(np.int32), emitter.astype(np.int32)
        self.inverse = 1 / (depth * (small.directions(small.pixel_centres()) @ small.world_from_camera[:, 2]))
        code = (self.face + 1) * (self.emitter.max() + 2) + self.emitter + 1
        # between four pixels that show the same, and so do those round them: a corner may reach in between
        window = np.ones((4, 4), np.uint8)
        least, most = (filter(code.astype(np.float32), window, anchor=(1, 1), borderType=cv2.BORDER_REPLICATE)
                       for filter in (cv2.erode, cv2.dilate))
        self.plain = least == most

    def rows(self, top: int, bottom: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """depth (n, W) float64 [m], face and emitter (n, W) int32 of these rows."""
        camera, small = self.camera, self.small
        x, y = (np.arange(*ends) + 0.5 for ends in ((0, camera.width), (top, bottom)))
        (left, across), (above, down) = (
            _ends((at - camera.principal_point[k]) / camera.focal_length * small.focal_length
                  + small.principal_point[k] - 0.5, size) for k, (at, size) in enumerate(
                      zip((x, y), self.inverse.shape[::-1])))
        cell = np.ix_(above, left)
        below, right = np.minimum(above + 1, len(self.inverse) - 1), np.minimum(left + 1, self.inverse.shape[1] - 1)
        with np.errstate(invalid="ignore", divide="ignore"):
            columns = self.inverse[above] * (1 - down[:, None]) + self.inverse[below] * down[:, None]
            depth = 1 / (columns[:, left] * (1 - across) + columns[:, right] * across)
        slope_x, slope_y = ((at - camera.principal_point[k]) / camera.focal_length for k, at in enumerate((x, y)))
        depth *= np.sqrt(1 + slope_x**2 + slope_y[:, None] ** 2)
        face, emitter = self.face[cell], self.emitter[cell]
        rows, columns = np.nonzero(~self.plain[cell])
        for first in range(0, len(rows), _RAYS):
            at = rows[first:first + _RAYS], columns[first:first + _RAYS]
            rays = camera.directions(np.stack([x[at[1]], y[at[0]]], -1))
            depth[at], face[at], emitter[at] = (found[0] for found in seen_along(
                camera.position, rays[None], self.shapes, self.lights))
        return depth, face, emitter


def _ends(at: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    """The pixel before each place, counted from pixel centres, and how far it lies beyond that; lines go on outside."""
    low = np.clip(np.floor(at), 0, max(size - 2, 0)).astype(int)
    return low, at - low
