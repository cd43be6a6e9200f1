"""The direction of a scene's sun: by windows and their patches, by shadows, by date and place, or as given."""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline.errors import InputError
from pipeline.estimation.solar_position import sun_at
from pipeline.estimation.sun_direction import Opening, estimate_sun_direction
from pipeline.estimation.sun_from_shadow import direction_from_shadows
from pipeline.geometry.camera import Camera
from pipeline.geometry.planes import polygon_normal
from pipeline.plugins.base import Light
from pipeline.plugins.lights.sun import Sun, shafts
from pipeline.plugins.lights.sunlight import Sunlight

#: A cone wider than this [degree] is no direction to render with before it was looked at.
MOST_DOUBT = 10.0
#: Times that a direction is found again from clicks that are a little off, for its confidence: by windows and by shadows;
#: and where that must be quick.
RESAMPLES, QUICK = (40, 200), (0, 6)


def is_sun(light: Light) -> bool:
    return isinstance(light, (Sun, Sunlight))


def stated_at(name: str, light: Light, settings) -> tuple[str, ...]:
    """Keys of what the direction comes from in the scene file, for messages."""
    if light.direction is None and isinstance(light, Sunlight) and settings.type != "window_patches":
        return ("sun_direction",)
    return "lights", name


def described_sun(name: str, light: Light, camera: Camera, settings, resamples: tuple[int, int] = RESAMPLES,
                  near: np.ndarray | None = None) -> dict[str, Any]:
    """Direction in which a placed sun's light travels, and what is worth reporting of it.

    settings: the estimator of sun directions. resamples: RESAMPLES or QUICK. near (3,): a direction that
    was found for nearly the same windows and patches. Raises InputError where nothing tells the direction, or it cannot be.
    """
    if light.direction is not None:
        found = _given(name, light)
    elif isinstance(light, Sunlight):
        found = _over_open_ground(name, camera, settings, resamples[1])
    else:
        found = _through_windows(name, light, camera, settings, resamples[0], near)
    if isinstance(light, Sun):
        shafts(light.model_copy(update={"direction": found["sun_direction"]}))
    return found


def _given(name: str, light: Sun | Sunlight) -> dict:
    direction = np.asarray(light.direction)
    for key, opening in light.openings.items() if isinstance(light, Sun) else ():
        if polygon_normal(opening.window.polygon) @ direction <= 1e-3:
            raise InputError(f"{name}: direction {direction.tolist()} does not enter through window '{key}'",
                             remedy="let it point from the sun into the room")
        # a patch along the light is none: pulled back to the window it shrinks to a line, and all would be dark
        if any(abs(polygon_normal(patch.polygon) @ direction) <= 1e-3 for patch in opening.patches):
            raise InputError(f"{name}: direction {direction.tolist()} runs along a patch of window '{key}'",
                             remedy="correct the direction, or the plane of the patch")
    # at the horizon it may shine through a window, from below it may not
    if direction[1] > 0 or isinstance(light, Sunlight) and direction[1] >= 0:
        raise InputError(f"{name}: direction {direction.tolist()} does not come from above the horizon",
                         remedy="let it point from the sun downwards, y < 0")
    return {"sun_direction": light.direction, "status": "given", "messages": []}


def _through_windows(name: str, sun: Sun, camera: Camera, settings, resamples: int, near) -> dict:
    if settings.type != "window_patches":
        raise InputError(f"{name}: {settings.type} knows no windows",
                         remedy="choose sun_direction type window_patches, or give the light a 'direction'")
    openings = [Opening(key, o.window.polygon, [(p.polygon, None) for p in o.patches])
                for key, o in sun.openings.items()]
    estimate = estimate_sun_direction(camera, openings, starts=settings.starts, seed=settings.seed,
                                      noise=settings.annotation_noise, resamples=resamples, near=near)
    if estimate.status == "impossible":
        raise InputError(f"no sun direction explains the patches: {'; '.join(estimate.messages)}",
                         remedy="correct the window and patch polygons, or give the light a 'direction'")
    return {
        "sun_direction": estimate.sun_direction, "status": estimate.status, "objective": estimate.objective,
        "confidence_degree": estimate.confidence, "farthest_start": estimate.farthest_start,
        "openings": {o.name: {"overlap": o.overlap, "angle_rms_degree": o.rms, "angle_max_degree": o.largest}
                     for o in estimate.openings},
        "alternatives": list(estimate.alternatives), "messages": [*estimate.messages, *estimate.notes]}


def _over_open_ground(name: str, camera, settings, trials: int) -> dict:
    if settings.type == "window_patches":
        raise InputError(f"{name}: window_patches knows no open ground",
                         remedy="choose sun_direction type cast_shadow or solar_position, or give the light a"
                                " 'direction'")
    if settings.type == "solar_position":
        found = sun_at(settings.time, settings.time_zone, settings.latitude, settings.longitude, settings.heading,
                       camera)
        return {"sun_direction": found.direction, "status": "determined", "messages": found.messages,
                "elevation_degree": found.elevation, "azimuth_from_north_degree": found.azimuth}
    found = direction_from_shadows(camera, [(s.foot, s.tip, s.shadow) for s in settings.shadows],
                                   settings.annotation_noise, settings.seed, trials)
    doubt = []
    if not found.agree:
        worst = int(np.argmax(found.residuals))
        doubt.append(f"the shadows disagree: {found.rms:.0f} pixels RMS, shadows[{worst}] most; its thing may lean, stand"
                     " on a slope, or have another shadow")
    if found.confidence > MOST_DOUBT:
        doubt.append(f"clicks leave {found.confidence:.0f} degrees of doubt: click a longer shadow, or one nearer to"
                     " the camera")
    return {"sun_direction": found.direction, "status": "ambiguous" if doubt else "determined",
            "confidence_degree": found.confidence, "residual_rms_pixel": found.rms,
            "residuals_pixel": found.residuals.tolist(), "messages": doubt}
