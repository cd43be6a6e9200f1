"""The sun's direction from upright things and their shadows on level ground."""

from __future__ import annotations

from dataclasses import dataclass

import nlopt
import numpy as np

from pipeline.errors import InputError
from pipeline.estimation.spherical import mean_direction
from pipeline.geometry.camera import Camera


@dataclass(frozen=True)
class ShadowDirection:
    """direction (3,) in which sunlight travels; rms [degree] between the things; confidence [degree] at 95 %."""

    direction: np.ndarray
    rms: float
    confidence: float


def direction_from_shadows(camera: Camera, shadows: list[tuple[np.ndarray, np.ndarray, np.ndarray]], noise: float,
                           seed: int, trials: int = 200) -> ShadowDirection:
    """Direction that throws each upright thing's tip onto its shadow's tip.

    shadows: (foot, tip, shadow tip) [pixel] each, foot and shadow on the ground y = 0. The direction is that of
    least squares in pixels of the projected shadow tips, found with nlopt. noise [pixel]: how exactly they were
    clicked; the confidence is the cone that holds 95 % of the directions from clicks moved at random by that.
    Raises InputError where a foot or shadow is above the horizon or the sun would stand below it.
    """
    for foot, _, shadow in shadows:
        for what, pixel in (("foot", foot), ("shadow", shadow)):
            if camera.directions(pixel)[1] >= -1e-6:
                raise InputError(f"the {what} {np.asarray(pixel).tolist()} lies above the horizon",
                                 remedy="click it on the ground")
    best = _fitted(camera, shadows)
    singles = np.array([_single(camera, *shadow) for shadow in shadows])
    rms = float(np.degrees(np.sqrt(np.mean(np.arccos(np.clip(singles @ best, -1, 1)) ** 2))))
    random = np.random.default_rng(seed)
    off = []
    for _ in range(trials):
        moved = [tuple(np.asarray(p, float) + random.normal(0, noise, 2) for p in shadow) for shadow in shadows]
        try:
            direction = mean_direction(np.array([_single(camera, *shadow) for shadow in moved]))
        except InputError:
            off.append(90.0)
            continue
        off.append(float(np.degrees(np.arccos(np.clip(direction @ best, -1, 1)))))
    return ShadowDirection(best, rms, float(np.quantile(off, 0.95)))


def _on_ground(camera: Camera, pixel: np.ndarray) -> np.ndarray:
    ray = camera.directions(np.asarray(pixel, float))
    if ray[1] > -1e-6:
        raise InputError(f"[{pixel[0]:.0f}, {pixel[1]:.0f}] lies above the horizon", remedy="click it on the ground")
    return camera.position - ray * (camera.position[1] / ray[1])


def _tip(camera: Camera, foot: np.ndarray, tip: np.ndarray) -> np.ndarray:
    """Point (3,) over the foot's ground point that the pixel `tip` shows: nearest to the upright line."""
    base, ray = _on_ground(camera, foot), camera.directions(np.asarray(tip, float))
    level = np.array([ray[0], 0.0, ray[2]])
    along = ((base - camera.position) @ level) / max(level @ level, 1e-12)
    point = camera.position + along * ray
    if point[1] <= 1e-3:
        raise InputError(f"the tip {np.asarray(tip).tolist()} is not above its foot {np.asarray(foot).tolist()}",
                         remedy="click the top of something upright")
    return np.array([base[0], point[1], base[2]])


def _single(camera: Camera, foot, tip, shadow) -> np.ndarray:
    way = _on_ground(camera, shadow) - _tip(camera, foot, tip)
    return way / np.linalg.norm(way)


def _fitted(camera: Camera, shadows) -> np.ndarray:
    start = mean_direction(np.array([_single(camera, *shadow) for shadow in shadows]))
    if len(shadows) == 1:
        return start
    tips = [_tip(camera, foot, tip) for foot, tip, _ in shadows]

    def direction(angles: np.ndarray) -> np.ndarray:
        elevation, azimuth = angles
        return np.array([np.cos(elevation) * np.sin(azimuth), -np.sin(elevation),
                         np.cos(elevation) * np.cos(azimuth)])

    def cost(angles: np.ndarray, _gradient) -> float:
        way, total = direction(angles), 0.0
        for tip, (_, _, shadow) in zip(tips, shadows):
            landed, depth = camera.project(tip - way * (tip[1] / way[1]))
            total += float(((landed - shadow) ** 2).sum()) if depth > 0 else 1e8
        return total

    optimiser = nlopt.opt(nlopt.LN_NELDERMEAD, 2)
    optimiser.set_min_objective(cost)
    first = np.array([np.arcsin(np.clip(-start[1], 1e-3, 1)), np.arctan2(start[0], start[2])])
    optimiser.set_lower_bounds([1e-3, first[1] - np.pi])
    optimiser.set_upper_bounds([np.pi / 2, first[1] + np.pi])
    optimiser.set_initial_step(0.05)
    optimiser.set_xtol_abs(1e-9)
    optimiser.set_maxeval(2000)
    return direction(optimiser.optimize(np.clip(first, optimiser.get_lower_bounds(), optimiser.get_upper_bounds())))
