"""The camera that a scene describes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from pipeline.errors import InputError
from pipeline.geometry import vanishing_points as vp
from pipeline.geometry.camera import Camera, from_exif_35mm, from_field_of_view, rotation
from pipeline.geometry.fspy import camera_from_fspy
from pipeline.geometry.horizon import pitch_and_roll
from pipeline.geometry.planes import Plane
from pipeline.paths import Build, inside
from pipeline.scene.model import CameraDescription


def describe(c: CameraDescription, width: int, height: int, exif_35mm: float | None, build: Build
             ) -> tuple[Camera, dict]:
    """The camera that a scene describes, and what is worth reporting about it."""
    angles = {"yaw": c.yaw or 0.0, "pitch": c.pitch or 0.0, "roll": c.roll or 0.0}
    centre = np.asarray(c.principal_point, float) if isinstance(c.principal_point, list) else None
    report: dict = {"source": "angles", "messages": []}
    if c.fspy:
        camera = _by_fspy(inside(build, c.fspy))
        if (camera.width, camera.height) != (width, height):
            raise InputError(f"fSpy's picture has {camera.width}x{camera.height} pixels, the photograph"
                             f" {width}x{height}",
                             place=c.fspy, remedy="solve the same picture in fSpy")
        report["source"] = "fspy"
    elif c.lines:
        lines = {axis: np.asarray(segments, float) for axis, segments in c.lines.items()}
        by_lens = _by_lens(c, width, height, exif_35mm, centre, angles)
        focal = by_lens.focal_length if by_lens else None
        # annotated lines of two axes outweigh EXIF, which rounds and knows no crop
        stated = c.horizontal_field_of_view is not None or c.focal_length_35mm is not None
        if not stated and sum(len(segments) >= 2 for segments in lines.values()) >= 2:
            focal = None
        estimate = vp.calibrate(width=width, height=height, lines=lines, focal_length=focal,
                                principal_point="estimate" if c.principal_point == "estimate" else centre)
        camera = estimate.camera
        report = {"source": "vanishing points", "residual_rms_pixel": estimate.residual_rms,
                  "residuals_pixel": estimate.residuals,
                  "focal_length_sigma_pixel": estimate.focal_length_sigma,
                  "messages": [*estimate.assumptions, *estimate.warnings]}
    else:
        if c.principal_point == "estimate":
            raise InputError("principal_point: estimate needs lines", remedy="draw 'lines' along x, y and z")
        camera = _by_lens(c, width, height, exif_35mm, centre, angles)
        if camera is None:
            raise InputError("nothing tells the focal length",
                             remedy="draw 'lines', or give horizontal_field_of_view, focal_length_35mm or"
                                    " fspy")
        if c.horizon is not None:
            pitch, roll = pitch_and_roll(np.asarray(c.horizon, float), camera.focal_length,
                                         camera.principal_point)
            camera = replace(camera, world_from_camera=rotation(c.yaw or 0.0, pitch, roll))
            report["source"] = "horizon"
    if c.position is not None:
        forward = np.subtract(c.look_at, c.position)
        if np.linalg.norm(forward) < 1e-9:
            raise InputError(f"position and look_at are both {c.position}", remedy="look somewhere else")
        yaw = np.degrees(np.arctan2(forward[0], -forward[2]))
        pitch = np.degrees(np.arctan2(forward[1], np.hypot(forward[0], forward[2])))
        camera = Camera(width, height, camera.focal_length, camera.principal_point,
                        rotation(yaw, pitch, angles["roll"]), np.asarray(c.position, float))
    elif c.height is not None:
        camera = vp.scaled(camera, c.height / camera.position[1])
    else:
        known = c.known_length
        factor = vp.scale_from_known_length(camera, Plane.across("y", 0.0), np.asarray(known.pixels, float),
                                            known.length, name="the floor")
        camera = vp.scaled(camera, factor)
    return camera, report


def _by_fspy(path: Path) -> Camera:
    """The camera of an fSpy export, 1 m above the floor; messages carry the file's name."""
    try:
        return camera_from_fspy(path.read_bytes(), camera_height=1.0)
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", remedy="check the file's name",
                         place=str(path)) from None
    except InputError as error:
        raise error.at(str(path)) from None


def _by_lens(c: CameraDescription, width, height, exif_35mm, centre, angles) -> Camera | None:
    """The camera turned by hand, 1 m above the floor, where the scene or EXIF tells its focal length."""
    if c.horizontal_field_of_view is not None:
        return from_field_of_view(width, height, c.horizontal_field_of_view, principal_point=centre, **angles)
    film = c.focal_length_35mm or exif_35mm
    return from_exif_35mm(width, height, film, principal_point=centre, **angles) if film else None
