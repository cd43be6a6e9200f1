"""What the report says and shows of scenes in the open air."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

from pipeline.imaging.overlay_outdoors import OpenAir
from pipeline.paths import Build
from pipeline.physics.visibility import visibility, visibility_class
from pipeline.plugins.base import Shape
from pipeline.scene.artefacts import plugin_from_json, read_json


def open_air(geometry: dict[str, Any], parameters: dict[str, Any], surfaces: np.ndarray) -> OpenAir | None:
    """What the overlay draws of an open-air scene, from its resolved inputs and surfaces.exr (H, W, 3); None indoors."""
    if not geometry.get("outdoors"):
        return None
    regions = [(name, facts["class"], facts["depth_median_m"]) for name, facts in geometry["regions"].items()]
    described = parameters["depth"]["regions"]
    feet = [np.asarray(described[name]["foot"], float) for name in described if described[name].get("foot")]
    light, sun = parameters["illumination"], parameters["sun_direction"]
    patches = [(f"{kind}[{i}]", kind, _outline(one)) for kind in ("shadowed", "sunlit")
               for i, one in enumerate(light.get(kind, ()) if light["type"] == "liu_xing" else ())]
    shadows = [tuple(np.asarray(one[key], float) for key in ("foot", "tip", "shadow"))
               for one in (sun["shadows"] if sun["type"] == "cast_shadow" else ())]
    return OpenAir(surfaces[..., 2].astype(np.int32), regions, feet, patches, shadows)


def _outline(patch: dict[str, Any]) -> np.ndarray:
    """(n, 2) [pixel] of an outlined or a round patch."""
    if patch["pixels"] is not None:
        return np.asarray(patch["pixels"], float)
    turn = np.linspace(0, 2 * np.pi, 25)[:-1]
    return np.asarray(patch["pixel"], float) + patch["radius"] * np.stack([np.cos(turn), np.sin(turn)], 1)


def own_shapes(shapes: dict[str, Shape], geometry: dict[str, Any]) -> dict[str, Shape]:
    """The scene's shapes without those that stand in for regions, whose outlines are drawn instead."""
    standing_in = {f"region_{name}" for name in geometry.get("regions", ())}
    return {name: shape for name, shape in shapes.items() if name not in standing_in}


def region_rows(geometry: dict[str, Any]) -> list[dict[str, Any]]:
    """One row a region: name, class, share of the picture, median depth [m] and triangles of its stand-in."""
    return [{"name": name, **facts} for name, facts in geometry.get("regions", {}).items()]


def patch_rows(illumination: dict[str, Any]) -> list[dict[str, Any]]:
    """One row a patch that told of sun or sky: radiance (3,), standard error and pixels."""
    return [{"name": name, **facts} for name, facts in illumination.get("patches", {}).items()]


def fog_rows(build: Build) -> list[dict[str, Any]]:
    """The scene's named fogs, the thinnest first: visibility [m] where it is as dense as stated, and its report."""
    rows = []
    for name, described in read_json(build.input("fogs")).items():
        metres = visibility(sum(plugin_from_json("media", described).coefficients()))
        page = Build(build.scene, name, build.scenes, build.builds).report
        href = quote(Path(os.path.relpath(page, build.out)).as_posix()) if page.exists() else None
        rows.append({"name": name, "type": described["type"], "visibility": metres, "class": visibility_class(metres),
                     "href": href, "shown": name == build.fog})
    return sorted(rows, key=lambda row: -row["visibility"])
