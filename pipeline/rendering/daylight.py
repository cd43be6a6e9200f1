"""Sun and sky of a scene after Liu et al. 2009 and Xing et al. 2012, from patches of its photograph."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from pipeline.errors import InputError
from pipeline.estimation.daylight import Patch, fit_daylight
from pipeline.geometry.regions import polygon_mask
from pipeline.imaging.maps import read_map
from pipeline.paths import Build
from pipeline.scene.artefacts import read_json
from pipeline.scene.placed import PlacedScene

#: Asphalt is 0.1, concrete and grass 0.25, dry earth 0.3: where nothing is said, the middle of ordinary ground.
GUESSED_ALBEDO = 0.2


def daylight(build: Build, scene: PlacedScene, settings, names: list[str]) -> tuple[dict[str, dict], dict[str, Any]]:
    """Strengths of the lights `names`, all of type sky or sunlight, and what is worth reporting."""
    for name in names:
        if scene.lights[name].type not in ("sky", "sunlight"):
            raise InputError(f"liu_xing cannot estimate {name}, a light of type {scene.lights[name].type}",
                             remedy=f"give it a '{scene.lights[name].strength_name}', or choose illumination type karsch")
    suns = [light for light in scene.lights.values() if light.type == "sunlight"]
    if suns and not settings.sunlit:
        raise InputError("a sunlight without sunlit patches",
                         remedy="outline 'sunlit' patches, or leave the sunlight out under an overcast sky")
    photograph = read_map(build.photograph)
    clipped = read_map(build.shared / "clipped.exr") > 0.5
    normals = {name: np.asarray(normal) for name, normal in read_json(build.geometry)["region_normals"].items()}
    shadowed, sunlit = (
        [_patch(f"{kind}[{i}]", one, settings, photograph, clipped, normals)
         for i, one in enumerate(getattr(settings, kind))] for kind in ("shadowed", "sunlit"))
    ground = next((np.asarray(light.radiance) for light in scene.lights.values()
                   if light.type == "ground" and light.radiance is not None), _ground_radiance(build, photograph))
    fit = fit_daylight(shadowed, sunlit if suns else [], np.asarray(suns[0].direction) if suns else None, ground,
                       settings.scale)
    if isinstance(fit, str):
        raise InputError(fit, remedy="correct the patches in 'illumination'")
    messages = list(fit.messages)
    if settings.albedo is None and any(p.albedo is None for p in (*settings.shadowed, *settings.sunlit)):
        messages.append(f"the ground's albedo is taken as {GUESSED_ALBEDO}: the strength of the light is a guess of that;"
                        " give 'albedo'")
    if settings.sunlit and not suns:
        messages.append("there are sunlit patches but no light of type sunlight; they are not used")
    found = {}
    for name in names:
        sky = scene.lights[name].type == "sky"
        found[name] = {"strength": (fit.sky if sky else fit.sun).tolist(),
                       "standard_error": (fit.sky_error if sky else fit.sun_error).tolist(), "source": "liu_xing"}
    ratio = float(fit.sun.mean() / max(np.pi * fit.sky.mean(), 1e-300))
    return found, {"estimator": "liu_xing", "messages": messages, "patches": fit.patches,
                   "scale_source": "stated albedo" if settings.albedo is not None else "guess",
                   "sun_over_sky": ratio}


def _patch(name: str, described, settings, photograph, clipped, normals) -> Patch:
    if described.pixels is not None:
        mask = polygon_mask(clipped.shape, np.asarray(described.pixels, float))
    else:
        drawn = np.zeros(clipped.shape, np.uint8)
        centre = np.asarray(described.pixel, float) - 0.5
        cv2.circle(drawn, np.round(centre).astype(int).tolist(), max(1, round(described.radius)), 1, -1)
        mask = drawn > 0
    if not mask.any():
        raise InputError(f"{name} covers no pixel of the photograph", remedy="give it in pixels of the photograph")
    if described.on != "ground" and described.on not in normals:
        raise InputError(f"{name} lies on '{described.on}', which no region is",
                         remedy=f"use ground{''.join(', ' + n for n in normals)}")
    normal = np.array([0.0, 1.0, 0.0]) if described.on == "ground" else normals[described.on]
    albedo = described.albedo if described.albedo is not None else settings.albedo
    albedo = GUESSED_ALBEDO if albedo is None else albedo
    return Patch(name, photograph[mask], clipped[mask], np.maximum(np.broadcast_to(np.asarray(albedo, float), 3), 1e-4),
                 normal, described.sky_visibility)


def _ground_radiance(build: Build, photograph: np.ndarray) -> np.ndarray:
    faces = read_json(build.geometry)["ground_faces"]
    ground = np.isin(read_map(build.surfaces)[..., 0], faces)
    return np.maximum(photograph[ground], 0).mean(0) if ground.any() else np.zeros(3)
