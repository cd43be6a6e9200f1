"""Pinhole camera: between pixels of the photograph and rays in the world.

Conventions, stated once for the whole project:

- World: metres, right-handed, y up. The floor (or ground) is y = 0. x points right and z points
  towards the viewer for a camera of yaw 0, which looks along -z. Indoors the axes are those of
  the room's walls.
- Pixels: (u, v), u right, v down, origin at the top-left *corner* of the photograph, so that the
  centre of the first pixel is (0.5, 0.5). Annotations use this frame at the photograph's full size.
- Camera frame: x right, y down, z forward (Hartley & Zisserman; Zhao et al. 2013, eq. 7).
- Depth is radial: metres along the ray from the camera, not planar z.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.errors import InputError


@dataclass(frozen=True)
class Camera:
    """A pinhole camera without distortion.

    width, height: photograph [pixel]. focal_length [pixel] (square pixels).
    principal_point: (cx, cy) [pixel]. position: (3,) world [m].
    world_from_camera: (3, 3) rotation; its columns are the camera's right, down and forward
    directions in the world.
    """

    width: int
    height: int
    focal_length: float
    principal_point: np.ndarray
    world_from_camera: np.ndarray
    position: np.ndarray

    @property
    def intrinsic_matrix(self) -> np.ndarray:
        """K, (3, 3) [pixel] (Zhao et al. 2013, eq. 7)."""
        cx, cy = self.principal_point
        return np.array([[self.focal_length, 0, cx], [0, self.focal_length, cy], [0, 0, 1.0]])

    def directions(self, pixels: np.ndarray) -> np.ndarray:
        """Unit world directions, (..., 3), of the rays through `pixels`, (..., 2)."""
        pixels, turned = np.asarray(pixels, float), np.asarray(self.world_from_camera)
        right, down = ((pixels[..., k] - self.principal_point[k]) / self.focal_length for k in (0, 1))
        forward = 1 / np.sqrt(right * right + down * down + 1)
        right, down = right * forward, down * forward
        # of millions of pixels: one axis at a time costs half of a product of matrices
        found = np.empty((*pixels.shape[:-1], 3))
        for k in range(3):
            found[..., k] = turned[k, 0] * right + turned[k, 1] * down + turned[k, 2] * forward
        return found

    def pixel_centres(self) -> np.ndarray:
        """(height, width, 2) pixel coordinates of all pixel centres."""
        u, v = np.meshgrid(np.arange(self.width) + 0.5, np.arange(self.height) + 0.5)
        return np.stack([u, v], -1)

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pixels (..., 2) and planar depths (...) [m] of world `points`, (..., 3).

        A point at or behind the camera plane has a planar depth <= 0 and pixel NaN.
        """
        in_camera = (np.asarray(points, float) - self.position) @ np.asarray(self.world_from_camera)
        planar_depth = in_camera[..., 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            pixels = self.focal_length * in_camera[..., :2] / planar_depth[..., None] + self.principal_point
        pixels = np.where(planar_depth[..., None] > 0, pixels, np.nan)
        return pixels, planar_depth

    def resized(self, width: int, height: int) -> "Camera":
        """The same view sampled at another size of (nearly) the same aspect ratio."""
        scale = np.array([width / self.width, height / self.height])
        return Camera(width, height, self.focal_length * float(np.sqrt(scale.prod())),
                      np.asarray(self.principal_point) * scale, self.world_from_camera, self.position)


def rotation(yaw: float = 0.0, pitch: float = 0.0, roll: float = 0.0) -> np.ndarray:
    """world_from_camera, (3, 3), of a camera turned from looking along -z.

    yaw [degree] turns to the right, pitch [degree] upwards, roll [degree] clockwise.
    """
    y, p, r = np.radians([yaw, pitch, roll])
    forward = np.array([np.sin(y) * np.cos(p), np.sin(p), -np.cos(y) * np.cos(p)])
    right = np.array([np.cos(y), 0.0, np.sin(y)])
    down = np.cross(forward, right)
    return np.stack([np.cos(r) * right + np.sin(r) * down, np.cos(r) * down - np.sin(r) * right, forward], 1)


def yaw_pitch_roll(world_from_camera: np.ndarray) -> tuple[float, float, float]:
    """The angles [degree] that `rotation` turns into this matrix.

    Yaw and roll lie in (-180, 180], pitch in [-90, 90]. Straight up or down only their combination
    is defined, and the roll is reported as 0.
    """
    right, down, forward = np.asarray(world_from_camera, float).T
    pitch = np.degrees(np.arctan2(forward[1], np.hypot(forward[0], forward[2])))
    if np.hypot(forward[0], forward[2]) < 1e-9:  # rounding of a unit vector is 1e-16; this is 2e-7 degrees
        return float(np.degrees(np.arctan2(right[2], right[0]))), float(pitch), 0.0
    yaw = np.degrees(np.arctan2(forward[0], -forward[2]))
    level = rotation(yaw, pitch)
    roll = np.degrees(np.arctan2(right @ level[:, 1], right @ level[:, 0]))
    return float(yaw), float(pitch), float(roll)


def centre_of(width: int, height: int) -> np.ndarray:
    """(cx, cy) [pixel] of a photograph that was not cropped (Zhao et al. 2013, below eq. 7)."""
    return np.array([width / 2, height / 2])


def from_field_of_view(
    width: int, height: int, horizontal_field_of_view_degrees: float, *, camera_height: float = 1.0,
    yaw: float = 0.0, pitch: float = 0.0, roll: float = 0.0, principal_point: np.ndarray | None = None,
) -> Camera:
    """The camera that sees the given angle across the photograph's width, turned by hand.

    camera_height [m] above the floor; it stands over the world's origin. Angles [degree] as in
    `rotation`. The angle is that of a centred view: focal_length = width / (2 tan(angle / 2)) also
    where `principal_point` [pixel] is off the centre.
    Raises InputError unless 0 < angle < 180.
    """
    angle = horizontal_field_of_view_degrees
    if not 0 < angle < 180:
        raise InputError(f"horizontal field of view is {angle:g} degrees",
                         remedy="state an angle between 0 and 180, e.g. 65 for a phone's main lens")
    focal_length = width / 2 / np.tan(np.radians(angle) / 2)
    return _by_hand(width, height, focal_length, camera_height, (yaw, pitch, roll), principal_point)


def from_exif_35mm(
    width: int, height: int, focal_35mm: float, *, camera_height: float = 1.0,
    yaw: float = 0.0, pitch: float = 0.0, roll: float = 0.0, principal_point: np.ndarray | None = None,
) -> Camera:
    """The camera whose EXIF tag FocalLengthIn35mmFilm [mm] is `focal_35mm`, turned by hand.

    The equivalence goes by the *diagonal*: that of a 36 x 24 mm frame, 43.27 mm, maps to that of the
    photograph, as camera makers do for sensors that are not 3:2. A cropped photograph keeps the tag
    but not the angle. Other parameters as in `from_field_of_view`.
    Raises InputError unless focal_35mm > 0 (EXIF writes 0 for "unknown").
    """
    if not (np.isfinite(focal_35mm) and focal_35mm > 0):
        raise InputError(f"35 mm equivalent focal length is {focal_35mm:g} mm (EXIF writes 0 for unknown)",
                         remedy="state a field of view or annotate parallel lines along two axes")
    focal_length = focal_35mm * np.hypot(width, height) / np.hypot(36.0, 24.0)
    return _by_hand(width, height, focal_length, camera_height, (yaw, pitch, roll), principal_point)


def _by_hand(width, height, focal_length, camera_height, angles, principal_point) -> Camera:
    centre = centre_of(width, height) if principal_point is None else np.asarray(principal_point, float)
    return Camera(width, height, float(focal_length), centre, rotation(*angles),
                  np.array([0.0, camera_height, 0.0]))
