"""Sun and sky of a scene after Liu et al. 2009 and Xing et al. 2012, from patches of its photograph."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from pipeline.errors import InputError, nearest
from pipeline.estimation.daylight import Patch, fit_daylight
from pipeline.estimation.surroundings import Surroundings
from pipeline.geometry.regions import polygon_mask
from pipeline.imaging.maps import read_map
from pipeline.paths import Build
from pipeline.scene.artefacts import annotation_scale, read_json, scene_place
from pipeline.scene.placed import PlacedScene

#: Asphalt is 0.1, concrete and grass 0.25, dry earth 0.3: where nothing is said, the middle of ordinary ground.
GUESSED_ALBEDO = 0.2
#: Where more than this share of a patch's light comes from outside the photograph, that is said.
MOST_UNSEEN = 0.4


def daylight(build: Build, scene: PlacedScene, settings, names: list[str], ground: np.ndarray
             ) -> tuple[dict[str, dict], dict[str, Any]]:
    """Strengths of the lights `names`, all of type sky or sunlight, and what is worth reporting.

    ground: radiance (3,) of the ground, which lights upright patches whose `sky_visibility` is stated.
    """
    found = {}
    for name in names:
        kind = scene.lights[name].type
        if kind not in ("sky", "sunlight"):
            raise InputError(f"liu_xing cannot estimate {name}, a light of type {kind}",
                             remedy=f"give it a '{scene.lights[name].strength_name}', or choose illumination type karsch")
        if kind in found:
            raise InputError(f"liu_xing cannot tell {found[kind]} and {name} apart, two lights of type {kind}",
                             remedy=f"give one of them a '{scene.lights[name].strength_name}', or leave it out")
        found[kind] = name
    sun = scene.lights[found["sunlight"]] if "sunlight" in found else None
    if sun is not None and not settings.sunlit:
        raise InputError(f"{found['sunlight']}, a sunlight, without sunlit patches",
                         remedy="outline 'sunlit' patches, or leave the sunlight out under an overcast sky")
    photograph, clipped = read_map(build.photograph), read_map(build.clipped) > 0.5
    messages: list[str] = []
    patches = {kind: _patches(build, scene, settings, kind, photograph, clipped, ground, messages)
               for kind in ("shadowed", "sunlit")}
    fit = fit_daylight(patches["shadowed"], patches["sunlit"], None if sun is None else np.asarray(sun.direction),
                       settings.scale)
    guessed = settings.albedo is None and any(p.albedo is None for p in (*settings.shadowed, *settings.sunlit))
    messages += fit.messages
    if guessed:
        messages.append(f"the ground's albedo is taken as {GUESSED_ALBEDO}: the strength of the light is a guess of that;"
                        " give 'albedo'")
    if settings.sunlit and sun is None:
        messages.append("no light of type sunlight is to be estimated; the sunlit patches are not used")
    lights = {name: {"strength": (fit.sky if kind == "sky" else fit.sun).tolist(),
                     "standard_error": (fit.sky_error if kind == "sky" else fit.sun_error).tolist(),
                     "source": "liu_xing"} for kind, name in found.items()}
    sky = float(np.pi * fit.sky.mean())
    return lights, {"estimator": "liu_xing", "messages": messages, "patches": fit.patches,
                    "scale_source": "guess" if guessed else "stated albedo",
                    "sun_over_sky": float(fit.sun.mean()) / sky if sky > 0 else None}


def _patches(build: Build, scene: PlacedScene, settings, kind: str, photograph: np.ndarray, clipped: np.ndarray,
             ground: np.ndarray, messages: list[str]) -> list[Patch]:
    normals = {name: np.asarray(normal) for name, normal in read_json(build.geometry)["region_normals"].items()}
    depth, face = read_map(build.depth).astype(float), read_map(build.surfaces)[..., 0].astype(int)
    around_it = Surroundings(scene.camera, scene.first_hit, photograph, depth, face)
    patches, scale = [], annotation_scale(build)
    for index, described in enumerate(getattr(settings, kind)):
        name = f"{kind}[{index}]"
        try:
            mask, normal = _mask(name, described, clipped.shape, scale), _normal(name, described.on, normals)
        except InputError as error:
            raise error.at(scene_place(build, "illumination", kind)) from None
        albedo = described.albedo if described.albedo is not None else settings.albedo
        albedo = np.broadcast_to(np.asarray(GUESSED_ALBEDO if albedo is None else albedo, float), 3)
        places = np.argwhere(mask)
        if described.sky_visibility is not None:
            up = float(1 + normal[1]) / 2
            sky, reflected = up * described.sky_visibility, (1 - up) * ground
        else:
            points = scene.camera.position + depth[mask][:, None] * scene.camera.directions(places[:, ::-1] + 0.5)
            around = around_it.of_patch(points, normal)
            sky, reflected = around.sky, around.reflected
            if around.unseen > MOST_UNSEEN:
                messages.append(f"{around.unseen:.0%} of the light on {name} comes from what the photograph does not show,"
                                " taken as bright as what it does; state its sky_visibility")
        patches.append(Patch(name, photograph[mask], clipped[mask], places, np.maximum(albedo, 1e-4), normal, sky,
                             reflected))
    return patches


def _mask(name: str, described, shape: tuple[int, int], scale: np.ndarray) -> np.ndarray:
    if described.pixels is not None:
        mask = polygon_mask(shape, np.asarray(described.pixels, float) * scale)
    else:
        drawn = np.zeros(shape, np.uint8)
        centre = np.asarray(described.pixel, float) * scale - 0.5
        cv2.circle(drawn, np.round(centre).astype(int).tolist(), max(1, round(described.radius * float(scale.mean()))), 1, -1)
        mask = drawn > 0
    if not mask.any():
        raise InputError(f"{name} covers no pixel of the photograph",
                         remedy="give it in pixels of the photograph, {:.0f} x {:.0f}".format(*(shape[::-1] / scale)))
    return mask


def _normal(name: str, on: str, normals: dict[str, np.ndarray]) -> np.ndarray:
    if on == "ground":
        return np.array([0.0, 1.0, 0.0])
    if on not in normals:
        known = list(dict.fromkeys(["ground", *normals]))
        raise InputError(f"{name} lies on '{on}', which no region of one plane is",
                         remedy=f"use one of {', '.join(known)}{nearest(on, known)}")
    return normals[on]
