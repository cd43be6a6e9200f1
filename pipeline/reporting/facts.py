"""Facts about a result for the report's tables, and what is known of their error."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pipeline.geometry.boxes import AxisBox
from pipeline.geometry.camera import Camera, yaw_pitch_roll
from pipeline.imaging.display import displayed
from pipeline.physics.visibility import visibility, visibility_class
from pipeline.plugins.base import Medium
from pipeline.scene.placed import PlacedScene


def corner_fits(annotated: dict[str, dict], scene: PlacedScene) -> list[tuple[np.ndarray, np.ndarray]]:
    """Clicked and fitted pixel (2,) of each annotated corner of boxes and rooms."""
    pairs = []
    for name, shape in scene.shapes.items():
        box = getattr(shape, "box", None)
        if box is None and hasattr(shape, "lower"):
            box = AxisBox(np.asarray(shape.lower, float), np.asarray(shape.upper, float))
        if isinstance(box, AxisBox):
            pairs += [(np.asarray(pixel, float), scene.camera.project(box.corner(corner))[0])
                      for corner, pixel in annotated.get(name, {}).get("corners", {}).items()]
    return pairs


def notices(artefacts: dict[str, Any]) -> list[dict[str, str]]:
    """What a person should know first: every stage's messages, in the order of the stages."""
    found = [("camera", m) for m in artefacts["camera"].get("messages", [])]
    found += [("geometry", m) for m in artefacts["geometry"].get("messages", [])]
    for name, sun in artefacts["suns"].items():
        if sun.get("status") not in ("given", "determined"):
            found.append(("sun direction", f"{name}: the direction is {sun.get('status')}"))
        found += [("sun direction", f"{name}: {m}") for m in sun.get("messages", [])]
    illumination = artefacts["illumination"]
    found += [("illumination", m) for m in illumination.get("messages", [])]
    for pair in illumination.get("inseparable", []):
        if not any(all(f"'{name}'" in m for name in pair) for _, m in found):
            found.append(("illumination", f"{' and '.join(pair)} cannot be told apart in this photograph"))
    clipped = artefacts["facts"].get("clipped_share", 0)
    if clipped > 0.2:  # more than the lamps and windows of most rooms
        found.append(("photograph",
                      f"{clipped:.0%} of its pixels are clipped: brighter than the file can say, they darken"
                      " too much in fog"))
    return [{"stage": stage, "text": text} for stage, text in found]


def light_rows(illumination: dict[str, Any], gains: dict[str, float]) -> list[dict[str, Any]]:
    """One row a light: strength (3,), standard error, unit, and a swatch of its colour."""
    rows = []
    for name, light in illumination["lights"].items():
        strength = np.asarray(light["strength"], float)
        tint = displayed((strength / max(strength.max(), 1e-300))[None, None])[0, 0]
        error = light.get("standard_error")
        uncertain = light["source"] != "given" and error is not None
        rows.append({"name": name, **light, "gain": gains[name],
                     "swatch": "#%02x%02x%02x" % tuple(int(x) for x in tint),
                     "standard_error": np.broadcast_to(error, 3).tolist() if uncertain else None})
    return rows


def sun_rows(suns: dict[str, dict]) -> list[dict[str, Any]]:
    rows = []
    for name, sun in suns.items():
        x, y, z = sun["sun_direction"]
        rows.append({"openings": {}, "confidence_degree": None, **sun, "name": name,
                     "elevation": math.degrees(math.asin(np.clip(-y, -1, 1))),
                     # of where it comes from: to the right of where a camera of yaw 0 looks
                     "azimuth": math.degrees(math.atan2(-x, z))})
    return rows


def camera_facts(camera: Camera, artefact: dict[str, Any]) -> dict[str, Any]:
    yaw, pitch, roll = yaw_pitch_roll(camera.world_from_camera)
    return {"yaw": yaw, "pitch": pitch, "roll": roll, "height": float(camera.position[1]),
            "position": camera.position.tolist(), "focal_length": camera.focal_length,
            "principal_point": np.asarray(camera.principal_point).tolist(),
            "horizontal": math.degrees(2 * math.atan(camera.width / 2 / camera.focal_length)),
            "vertical": math.degrees(2 * math.atan(camera.height / 2 / camera.focal_length)),
            "source": artefact.get("source"), "residual": artefact.get("residual_rms_pixel"),
            "sigma": artefact.get("focal_length_sigma_pixel")}


def fog_facts(medium: Medium, camera: Camera, depth: np.ndarray) -> dict[str, Any]:
    """Coefficients [1/m] per channel, the visibility [m] they amount to, optical depth of what is seen."""
    absorption, scattering = medium.coefficients()
    extinction = absorption + scattering
    step = max(1, round(max(depth.shape) / 200))  # a median needs no more than 200 x 200 of the pixels
    v, u = np.mgrid[step // 2 : depth.shape[0] : step, step // 2 : depth.shape[1] : step]
    points = camera.position + depth[v, u][..., None] * camera.directions(np.stack([u, v], -1) + 0.5)
    optical_depth = medium.optical_depth(camera.position, points).mean(-1)
    phase = medium.phase().model_dump(mode="json")
    metres = visibility(extinction)
    return {"type": medium.type, "absorption": absorption.tolist(), "scattering": scattering.tolist(),
            "extinction": extinction.tolist(), "visibility": metres,
            "visibility_class": visibility_class(metres),
            "optical_depth_median": float(np.median(optical_depth)),
            "optical_depth_p99": float(np.percentile(optical_depth, 99)), "phase_function": phase.pop("type"),
            "phase_parameters": {k: v for k, v in phase.items() if isinstance(v, (int, float))}}


def estimated_error(artefacts: dict[str, Any]) -> dict[str, Any]:
    """What is known of how far the estimates are off; None where nothing was estimated."""
    camera, illumination, suns = artefacts["camera"], artefacts["illumination"], artefacts["suns"]
    residuals, lights = artefacts["geometry"]["residuals_pixel"], illumination["lights"]
    return {
        "camera_residual_rms_pixel": camera.get("residual_rms_pixel"),
        "focal_length_sigma_pixel": camera.get("focal_length_sigma_pixel"),
        "shape_residual_rms_pixel": {n: r["rms"] for n, r in residuals.items()},
        "sun_direction_confidence_degree": {n: s.get("confidence_degree") for n, s in suns.items()},
        "sun_patch_overlap": {n: {k: o["overlap"] for k, o in s.get("openings", {}).items()}
                              for n, s in suns.items()},
        "illumination_residual_median": illumination.get("residual_median"),
        "illumination_residual_p90": illumination.get("residual_p90"),
        "illumination_condition_number": illumination.get("condition_number"),
        "strength_standard_error": {n: light.get("standard_error") for n, light in lights.items()}}
