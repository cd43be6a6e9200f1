"""All of a scene's files -> overlay.png, manifest.json, report.html.

The manifest says what the result was made from and how far to trust it; the report shows it to a person. It
is written last, so that Make, which looks at the report, finds a manifest and an overlay that belong to it. Pictures of
a photograph larger than its working size are made from images of that size, but for the foggy one.
"""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from pipeline.imaging.atomic import replacing
from pipeline.imaging.canvas import LONG_SIDE
from pipeline.imaging.display import (
    FLOAT_KINDS, LONGEST, data_uri, depth_picture, display_exposure, displayed, shrunk, tone_factor, write_png)
from pipeline.imaging.map_strips import MapReader
from pipeline.imaging.maps import read_map
from pipeline.imaging.overlay import COLOURS, overlay
from pipeline.imaging.overlay_outdoors import OpenAir
from pipeline.paths import Build
from pipeline.reporting.facts import (
    camera_facts, corner_fits, estimated_error, fog_facts, light_rows, notices, sun_rows)
from pipeline.reporting.manifest import links, manifest_of, run_seconds, stage_seconds
from pipeline.reporting.outdoors import fog_rows, open_air, own_shapes, patch_rows, region_rows
from pipeline.reporting.page import page
from pipeline.reporting.planned import in_words, outcome, shortcomings
from pipeline.scene.artefacts import image_camera, image_size, read_fog, read_json, read_placed, working, write_json
from pipeline.scene.placed import PlacedScene

PARTS = ("photograph", "camera", "depth", "shapes", "lights", "strengths", "illumination", "sun_direction", "fog",
         "render", "composite")
#: What the overlay's colours mean.
KEY = {"room": "room", "shape": "shapes; thin where hidden", "support": "ground", "vertical": "upright regions",
       "sky": "sky", "map": "by the depth map", "foot": "foot lines, posts", "sunlit": "in the sun, sunlight",
       "shadowed": "in the shade, shadows", "lamp": "lamps", "window": "windows", "patch": "sun patches as annotated",
       "cast": "windows cast along the sun", "shaft": "volume of the sunlight", "sun": "sun", "horizon": "horizon"}


def run(build: Build) -> None:
    artefacts = {name: read_json(path) for name, path in {
        "facts": build.photograph_facts, "camera": build.camera, "geometry": build.geometry,
        "illumination": build.illumination, "plan": build.plan}.items()}
    artefacts["suns"] = read_json(build.sun_direction)["suns"] if build.sun_direction.exists() else {}
    parameters = {part: read_json(build.input(part)) for part in PARTS}
    scene, medium = read_placed(build), read_fog(build)
    images = working(build)
    size, unchanged = image_size(build)[::-1], artefacts["plan"]["fog_is_clear"] and not parameters["composite"]["exposure"]
    with ThreadPoolExecutor() as pool:
        read = [pool.submit(_shrunk, path, size) for path in (build.photograph, *(() if unchanged else (build.foggy(".exr"),)))]
    (radiance, foggy), depth = (read[0].result(), read[-1].result()), read_map(images.depth)

    exposure = display_exposure(radiance) if artefacts["facts"]["suffix"] in FLOAT_KINDS else 1.0
    air = open_air(artefacts["geometry"], parameters, read_map(images.surfaces))
    drawn = overlay(displayed(shrunk(radiance, LONG_SIDE[1]), exposure), scene.camera,
                    own_shapes(scene.shapes, artefacts["geometry"]), scene.lights, depth,
                    corner_fits(parameters["shapes"], scene), air)
    write_png(build.overlay, drawn)

    seconds = {"stages": stage_seconds(build), "runs": run_seconds(build, artefacts["plan"])}
    errors = estimated_error(artefacts)
    maps = {} if artefacts["plan"]["fog_is_clear"] else read_json(build.maps)
    planned = outcome(artefacts["plan"], maps, seconds["stages"])
    manifest = manifest_of(build, artefacts, parameters, seconds, errors, planned)
    write_json(build.manifest, manifest)
    if planned:
        print(f"  {in_words(planned)}", file=sys.stderr, flush=True)
    for one in shortcomings(planned):
        print(f"  note: {one['text']}", file=sys.stderr, flush=True)

    told = notices(artefacts) + shortcomings(planned) + [{"stage": "render", "text": text} for text in manifest["povray_warnings"]]
    pictures = _pictures(images, artefacts["plan"], radiance, foggy, depth, drawn, exposure)
    text = page(
        build, pictures=pictures, notices=told,
        lights=light_rows(artefacts["illumination"], read_json(build.input("gains"))),
        suns=sun_rows(artefacts["suns"]), camera=camera_facts(scene.camera, artefacts["camera"]),
        residuals=artefacts["geometry"]["residuals_pixel"], fog=fog_facts(medium, image_camera(images), depth),
        regions=region_rows(artefacts["geometry"]),
        sky_seen=(artefacts["illumination"].get("surroundings") or {}).get("sky_seen"), patches=patch_rows(artefacts["illumination"]),
        illumination=artefacts["illumination"], fogs=fog_rows(build), key=_key(scene, air, parameters),
        seconds=seconds, planned=planned and in_words(planned), errors=errors, manifest=manifest, plan=artefacts["plan"], facts=artefacts["facts"],
        links=links(build, artefacts), exposure=exposure,
        colours={name: "#%02x%02x%02x" % rgb for name, rgb in COLOURS.items()})
    with replacing(build.report) as name:
        name.write_text(text, encoding="utf-8")


def _key(scene: PlacedScene, air: OpenAir | None, parameters: dict[str, Any]) -> list[tuple[str, str]]:
    """Colours that the overlay uses for this scene, with what they mean."""
    kinds = {light.type for light in scene.lights.values()}
    drawn = {"room": not scene.outdoors, "shape": not scene.outdoors or bool(parameters["shapes"]), "horizon": True,
             "lamp": bool(kinds - {"sun", "sunlight", "sky", "ground", "ambient"}),
             **dict.fromkeys(("window", "patch", "cast", "shaft", "sun"), "sun" in kinds)}
    if air is not None:
        found = {kind for _, kind, _ in air.regions}
        drawn |= {kind: kind in found for kind in ("support", "vertical", "sky", "map")}
        drawn |= {"foot": bool(air.feet) or bool(air.shadows) or "sunlight" in kinds}
        drawn |= dict.fromkeys(("sunlit", "shadowed"), bool(air.patches) or bool(air.shadows) or "sunlight" in kinds)
    return [(name, text) for name, text in KEY.items() if drawn.get(name)]


def _pictures(build: Build, plan: dict, radiance: np.ndarray, foggy: np.ndarray, depth: np.ndarray, drawn: np.ndarray,
              exposure: float) -> dict[str, Any]:
    def picture(linear, factor):
        return data_uri(displayed(shrunk(linear), factor))

    width, height = image_size(build.full)
    ramp, near, far, logarithmic = depth_picture(depth, read_json(build.geometry).get("sky_depth_m"))
    pictures = {
        "width": width, "height": height, "photograph": picture(radiance, exposure),
        "foggy": picture(foggy, exposure), "depth": data_uri(shrunk(ramp)), "near": near, "far": far,
        "logarithmic": logarithmic,
        "overlay": data_uri(shrunk(drawn, LONGEST + 100), 90), "in_scattering_lights": []}
    if not plan["fog_is_clear"]:
        total = shrunk(read_map(build.in_scattering()))
        medians = read_json(build.maps)
        pictures |= {
            "transmittance": picture(read_map(build.transmittance), 1.0),
            "transmittance_median": medians["transmittance_median"],
            "in_scattering": picture(total, exposure),
            "in_scattering_median": medians["in_scattering_median"]}
        for light in plan["lights"]:
            one = shrunk(read_map(build.in_scattering(light)))
            factor = tone_factor(one)
            pictures["in_scattering_lights"].append({
                "name": light, "factor": factor, "black": not one.any(), "picture": picture(one, factor),
                "share": float(one.sum(dtype=float) / max(total.sum(dtype=float), 1e-300))})
    return pictures


def _shrunk(path: Path, size: tuple[int, int]) -> np.ndarray:
    """A map of this size (H, W), no larger than its pictures need, read some rows at a time."""
    height, width = size
    rows = max(size) // LONG_SIDE[1]
    if rows < 2:
        return read_map(path)
    reader = MapReader(path, size)
    # whole numbers of rows are averaged at once; the rest `shrunk` does
    parts = []
    for top in range(0, height - rows + 1, 64 * rows):
        strip = reader.rows(top, min(top + 64 * rows, height // rows * rows))
        parts.append(cv2.resize(strip, (max(1, width // rows), len(strip) // rows), interpolation=cv2.INTER_AREA))
    return np.concatenate(parts)
