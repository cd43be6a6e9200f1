"""Perspective photographs out of equirectangular panoramas."""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.geometry.camera import Camera, rotation


def view_camera(yaw: float, pitch: float, horizontal_field_of_view: float, width: int, height: int) -> Camera:
    """The camera of a view: at the origin, principal point in the middle. Angles in degrees."""
    if not 0 < horizontal_field_of_view < 180:
        raise ValueError(f"horizontal_field_of_view {horizontal_field_of_view}: between 0 and 180 degrees")
    focal_length = width / 2 / np.tan(np.radians(horizontal_field_of_view) / 2)
    return Camera(width, height, float(focal_length), np.array([width / 2, height / 2]),
                  rotation(yaw, pitch), np.zeros(3))


def perspective_view(panorama: np.ndarray, yaw: float, pitch: float, horizontal_field_of_view: float,
                     width: int, height: int) -> np.ndarray:
    """What a pinhole camera sees of `panorama`, (H, W, 3) linear: (height, width, 3) float32, linear.

    The panorama's middle column lies along -z (yaw 0) and its upper edge straight up. yaw [degree]
    turns to the right, pitch [degree] upwards, as in `geometry.camera.rotation`; the rays are those
    of `view_camera`. Bilinear, which unlike sharper filters rings neither round lamps nor below
    zero; where the panorama is finer than the view, several rays a pixel are averaged.
    """
    panorama = np.asarray(panorama, np.float32)
    pixels_per_radian = panorama.shape[1] / (2 * np.pi)
    camera = view_camera(yaw, pitch, horizontal_field_of_view, width, height)
    # A view pixel is widest in angle at its centre: 1 / focal_length radians.
    rays = max(1, int(np.ceil(pixels_per_radian / camera.focal_length)))
    fine = view_camera(yaw, pitch, horizontal_field_of_view, width * rays, height * rays)
    samples = _sample(panorama, fine.directions(fine.pixel_centres()))
    return samples.reshape(height, rays, width, rays, -1).mean((1, 3), dtype=np.float64).astype(np.float32)


def _sample(panorama: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Bilinear values, (h, w, c), of `panorama` in the unit world `directions`, (h, w, 3)."""
    height, width, channels = panorama.shape
    azimuth = np.arctan2(directions[..., 0], -directions[..., 2])
    elevation = np.arctan2(directions[..., 1], np.hypot(directions[..., 0], directions[..., 2]))
    column = (azimuth / (2 * np.pi) + 0.5) * width - 0.5  # index coordinates: pixel centres are integers
    row = (0.5 - elevation / np.pi) * height - 0.5
    # A border of one pixel: round the circle left and right, and across each pole above and below.
    across = np.roll(panorama, width // 2, axis=1)
    tall = np.concatenate([across[:1], panorama, across[-1:]])
    padded = np.concatenate([tall[:, -1:], tall, tall[:, :1]], axis=1)
    sampled = cv2.remap(padded, (column + 1).astype(np.float32), (row + 1).astype(np.float32),
                        cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return sampled.reshape(*directions.shape[:2], channels)
