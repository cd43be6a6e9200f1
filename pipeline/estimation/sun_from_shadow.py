"""The sun's direction from upright things and their shadows on level ground."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import nlopt
import numpy as np

from pipeline.errors import InputError
from pipeline.estimation.spherical import angles_between, mean_direction, unit
from pipeline.geometry.camera import Camera
from pipeline.geometry.regions import ground_point

#: Foot, tip and the tip's shadow, (2,) [pixel] each.
Shadow = tuple[np.ndarray, np.ndarray, np.ndarray]
#: Lower than this share of the camera's height is no upright thing.
LOWEST = 1e-3
#: Share of clicks of the stated noise whose residuals must be smaller, before things are said to disagree.
UNLIKELY = 0.99


@dataclass(frozen=True)
class ShadowDirection:
    """direction (3,) in which sunlight travels, and how far to trust it.

    residuals: (n,) [pixel] from each clicked shadow to where the direction throws it; rms: theirs. confidence
    [degree]: radius of the cone that holds the true direction in 95 of 100 cases. agree: whether clicks of the stated
    noise explain the residuals.
    """

    direction: np.ndarray
    residuals: np.ndarray
    rms: float
    confidence: float
    agree: bool


def direction_from_shadows(camera: Camera, shadows: Sequence[Shadow], noise: float, seed: int, trials: int = 200
                           ) -> ShadowDirection:
    """Direction that throws each upright thing's tip onto its shadow's tip.

    Feet and shadows lie on the ground y = 0. The direction is that of least squares in pixels of the projected
    shadow tips, found with nlopt. noise [pixel]: how exactly they were clicked. The confidence comes from the same
    fit to clicks that would agree on the direction, moved at random by that noise; where the things disagree more
    than it explains, the cone is as much wider. Raises InputError where a foot or shadow is above the horizon.
    """
    shadows = [tuple(np.asarray(pixel, float) for pixel in shadow) for shadow in shadows]
    tips = [_tip(camera, foot, tip) for foot, tip, _ in shadows]
    best = _fitted(camera, tips, [shadow for _, _, shadow in shadows])
    landed = camera.project(_landed(np.array(tips), best))[0]
    residuals = np.linalg.norm(landed - [shadow for _, _, shadow in shadows], axis=1)
    ideal = [(foot, tip, shadow) for (foot, tip, _), shadow in zip(shadows, landed)]
    random = np.random.default_rng(seed)
    off, scatter = [], []
    for _ in range(trials):
        moved = [tuple(pixel + random.normal(0, noise, 2) for pixel in shadow) for shadow in ideal]
        try:
            tips = [_tip(camera, foot, tip) for foot, tip, _ in moved]
            direction = _fitted(camera, tips, [shadow for _, _, shadow in moved])
        except InputError:  # moved over the horizon
            off.append(90.0)
            continue
        off.append(float(np.degrees(angles_between(direction, best))))
        scatter.append(_rms(camera.project(_landed(np.array(tips), direction))[0] - [m[2] for m in moved]))
    rms = _rms(residuals[:, None])
    agree = len(shadows) == 1 or not scatter or rms <= np.quantile(scatter, UNLIKELY)
    cone = float(np.quantile(off, 0.95)) * (1 if agree else rms / np.median(scatter))
    return ShadowDirection(best, residuals, rms, min(float(cone), 90.0), bool(agree))


def _rms(offsets: np.ndarray) -> float:
    """Root mean square length of vectors (n, k)."""
    return float(np.sqrt((offsets**2).sum(-1).mean()))


def _on_ground(camera: Camera, pixel: np.ndarray) -> np.ndarray:
    point = ground_point(camera, pixel)
    if point is None or camera.position[1] <= 0:
        raise InputError(f"[{pixel[0]:.0f}, {pixel[1]:.0f}] lies above the horizon", remedy="click it on the ground")
    return point


def _tip(camera: Camera, foot: np.ndarray, tip: np.ndarray) -> np.ndarray:
    """Point (3,) over the foot's ground point that the pixel `tip` shows: nearest to the upright line."""
    base, ray = _on_ground(camera, foot), camera.directions(tip)
    level = np.array([ray[0], 0.0, ray[2]])
    along = ((base - camera.position) @ level) / max(level @ level, 1e-12)
    height = camera.position[1] + along * ray[1]
    if along <= 0 or height <= LOWEST * camera.position[1]:
        raise InputError(f"the tip {tip.tolist()} is not above its foot {foot.tolist()}",
                         remedy="click the top of something upright")
    return np.array([base[0], height, base[2]])


def _landed(tip: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Where tips (..., 3) throw their shadows on the ground."""
    return tip - direction * (tip[..., 1:2] / direction[1])


def _fitted(camera: Camera, tips: Sequence[np.ndarray], shadows: Sequence[np.ndarray]) -> np.ndarray:
    """Direction (3,) of least squares in pixels.

    Its two unknowns are how far along x and z shadows reach a metre of height: finite for every sun above the
    horizon, and without a pole in the zenith.
    """
    start = mean_direction(unit(np.array([_on_ground(camera, shadow) for shadow in shadows]) - tips))
    if len(tips) == 1:
        return start
    to_camera, heights = np.asarray(camera.world_from_camera), np.array(tips)[:, 1]
    feet = (tips - camera.position - np.outer(heights, [0, 1, 0])) @ to_camera
    wanted = np.array(shadows) - camera.principal_point

    def cost(reach: np.ndarray, _gradient) -> float:
        landed = feet + np.outer(heights, reach @ to_camera[[0, 2]])
        if landed[:, 2].min() <= 0:
            return 1e12
        return float(((camera.focal_length * landed[:, :2] / landed[:, 2:] - wanted) ** 2).sum())

    first = start[[0, 2]] / -start[1]
    optimiser = nlopt.opt(nlopt.LN_NELDERMEAD, 2)
    optimiser.set_min_objective(cost)
    optimiser.set_initial_step(0.02 * (1 + first @ first))  # about a degree of elevation
    optimiser.set_xtol_abs(1e-7 * (1 + first @ first))
    optimiser.set_maxeval(1000)
    x, z = optimiser.optimize(first)
    return unit(np.array([x, -1.0, z]))
