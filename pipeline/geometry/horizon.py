"""Pitch and roll from the horizon in the photograph."""

from __future__ import annotations

import numpy as np

from pipeline.errors import InputError


def pitch_and_roll(horizon: np.ndarray, focal_length: float, principal_point: np.ndarray) -> tuple[float, float]:
    """Pitch upwards and roll clockwise [degree] of a camera that sees the horizon along `horizon` (2, 2) [pixel].

    The rays to the horizon are level: the plane that they span has the upward direction as its normal
    (Hartley & Zisserman, 8.6). Raises InputError where the line's ends are one point, or it stands upright.
    """
    ends = np.asarray(horizon, float)
    rays = np.column_stack([(ends - principal_point) / focal_length, np.ones(2)])
    down = np.cross(rays[1], rays[0])
    length = np.linalg.norm(down)
    if np.abs(ends[1] - ends[0]).max() < 1e-6 or length == 0:
        raise InputError(f"the horizon's two ends are one point {ends[0].tolist()}",
                         remedy="give two points far apart on it")
    down = down / length * (1 if down[1] > 0 else -1)
    if abs(down[0]) > 5 * down[1]:
        raise InputError("the horizon runs from top to bottom", remedy="turn the photograph upright first")
    # down is the world's downward direction in the camera's frame (x right, y down, z forward)
    pitch = np.degrees(np.arcsin(np.clip(-down[2], -1, 1)))
    roll = np.degrees(np.arctan2(down[0], down[1]))
    return float(pitch), float(roll)
