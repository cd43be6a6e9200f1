"""All of a scene's files -> overlay.png, manifest.json, report.html.

The manifest says what the result was made from and how far to trust it; the report shows it to a person. It
is written last, so that Make, which looks at the report, finds a manifest and an overlay that belong to it.
"""

from __future__ import annotations

import base64
import hashlib
import math
import os
import platform
import re
import tomllib
from importlib import metadata
from pathlib import Path
from typing import Any
from urllib.parse import quote

import cv2
import jinja2
import numpy as np
from jinja2.sandbox import SandboxedEnvironment

from pipeline import __version__, paths
from pipeline.errors import InputError
from pipeline.geometry.boxes import AxisBox
from pipeline.geometry.camera import Camera, yaw_pitch_roll
from pipeline.imaging.atomic import replacing
from pipeline.imaging.colour import linear_to_srgb
from pipeline.imaging.maps import read_map
from pipeline.imaging.overlay import COLOURS, LONG_SIDE, overlay
from pipeline.paths import Build
from pipeline.plugins.base import Medium
from pipeline.rendering import povray
from pipeline.rendering.emit import PlacedScene
from pipeline.scene.artefacts import read_fog, read_json, read_placed, write_json

PARTS = ("photograph", "camera", "shapes", "lights", "strengths", "illumination", "sun_direction", "fog",
         "render")
FOG_STAGES = ("plan", "emit", "render", "decompose", "composite")
SHARED_STAGES = ("photograph", "camera", "geometry", "sun_direction", "illumination")
#: Long side [pixel] of the report's pictures: ten of them as JPEG stay below 2 MB.
LONGEST = 900
FLOAT_KINDS = (".exr", ".hdr")


def run(build: Build) -> None:
    artefacts = {name: read_json(path) for name, path in {
        "facts": build.photograph_facts, "camera": build.camera, "geometry": build.geometry,
        "illumination": build.illumination, "plan": build.plan}.items()}
    artefacts["suns"] = read_json(build.sun_direction)["suns"] if build.sun_direction.exists() else {}
    parameters = {part: read_json(build.input(part)) for part in PARTS}
    scene, medium = read_placed(build), read_fog(build)
    radiance, depth = read_map(build.photograph), read_map(build.depth)

    exposure = display_exposure(radiance) if artefacts["facts"]["suffix"] in FLOAT_KINDS else 1.0
    drawn = overlay(displayed(shrunk(radiance, LONG_SIDE[1]), exposure), scene.camera, scene.shapes,
                    scene.lights, depth, corner_fits(parameters["shapes"], scene))
    _write_png(build.overlay, drawn)

    seconds = {"stages": _stage_seconds(build), "runs": _run_seconds(build, artefacts["plan"])}
    errors = estimated_error(artefacts)
    manifest = {
        "project": {"name": "fog-into-photographs", "version": __version__}, "scene": build.scene,
        "fog": build.fog or "default", "versions": _versions(),
        "sources": _sources(build, parameters["photograph"]), "parameters": parameters,
        "seconds": seconds, "estimated_error": errors, "outputs": _outputs(build, artefacts)}
    write_json(build.manifest, plain(manifest))

    pictures = _pictures(build, artefacts["plan"], radiance, depth, drawn, exposure)
    text = page(
        build, pictures=pictures, notices=notices(artefacts), lights=light_rows(artefacts["illumination"], read_json(build.input("gains"))),
        suns=sun_rows(artefacts["suns"]), camera=camera_facts(scene.camera, artefacts["camera"]),
        residuals=artefacts["geometry"]["residuals_pixel"], fog=fog_facts(medium, scene.camera, depth),
        seconds=seconds, errors=errors, manifest=manifest, plan=artefacts["plan"], facts=artefacts["facts"],
        links=_links(build, artefacts), exposure=exposure,
        colours={name: "#%02x%02x%02x" % rgb for name, rgb in COLOURS.items()})
    with replacing(build.report) as name:
        name.write_text(text, encoding="utf-8")


# ---- pictures ----------------------------------------------------------------------------------

def display_exposure(radiance: np.ndarray) -> float:
    """Factor for a float photograph whose unit is not white: its 99th percentile becomes white."""
    bright = float(np.percentile(np.nan_to_num(radiance, posinf=0, neginf=0).max(-1), 99))
    return 1.0 if bright <= 0 or 0.25 <= bright <= 2 else 1 / bright


def displayed(linear: np.ndarray, exposure: float = 1.0) -> np.ndarray:
    """(H, W, 3) uint8 sRGB of linear light (H, W, 3), clipped at white."""
    finite = np.nan_to_num(np.asarray(linear, np.float32), nan=0, posinf=1e30, neginf=0)
    return np.round(np.clip(linear_to_srgb(finite * np.float32(exposure)), 0, 1) * 255).astype(np.uint8)


def tone_factor(linear: np.ndarray) -> float:
    """Two-digit factor that brings nearly all of a map (99.5 %) below white; 1 for a black one."""
    bright = float(np.percentile(linear, 99.5)) or float(np.max(linear))
    return float(f"{1 / bright:.2g}") if 1e-30 < bright < 1e30 else 1.0


def depth_picture(depth: np.ndarray) -> tuple[np.ndarray, float, float]:
    """(H, W, 3) uint8, near dark and far bright, and the depths [m] of the two ends."""
    near, far = (float(x) for x in np.percentile(depth, [1, 99]))
    share = np.clip((depth - near) / max(far - near, 1e-12), 0, 1)
    colours = cv2.applyColorMap(np.round(share * 255).astype(np.uint8), cv2.COLORMAP_VIRIDIS)
    return colours[..., ::-1], near, far


def shrunk(image: np.ndarray, longest: int = LONGEST) -> np.ndarray:
    """At most `longest` pixels a side, averaged in the light that `image` holds."""
    scale = longest / max(image.shape[:2])
    if scale >= 1:
        return image
    size = (max(1, round(image.shape[1] * scale)), max(1, round(image.shape[0] * scale)))
    return cv2.resize(np.ascontiguousarray(image), size, interpolation=cv2.INTER_AREA)


def data_uri(image: np.ndarray, quality: int = 88) -> str:
    """An RGB picture (H, W, 3) uint8 written into the page."""
    options = [cv2.IMWRITE_JPEG_QUALITY, quality,  # full colour: thin coloured lines blur otherwise
               cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
    data = cv2.imencode(".jpg", image[..., ::-1], options)[1]
    return "data:image/jpeg;base64," + base64.b64encode(data).decode("ascii")


def _pictures(build: Build, plan: dict, radiance: np.ndarray, depth: np.ndarray, drawn: np.ndarray,
              exposure: float) -> dict[str, Any]:
    def picture(linear, factor):
        return data_uri(displayed(shrunk(linear), factor))

    ramp, near, far = depth_picture(depth)
    foggy = read_map(build.foggy(".exr")) if build.foggy(".exr").exists() else radiance
    pictures = {
        "width": radiance.shape[1], "height": radiance.shape[0], "photograph": picture(radiance, exposure),
        "foggy": picture(foggy, exposure), "depth": data_uri(shrunk(ramp)), "near": near, "far": far,
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


def _write_png(path: Path, image: np.ndarray) -> None:
    data = cv2.imencode(".png", image[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 6])[1]
    with replacing(path) as name:
        name.write_bytes(data)


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


# ---- facts -------------------------------------------------------------------------------------

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
        found.append(("photograph", f"{clipped:.0%} of its pixels are clipped: brighter than the file can say,"
                                    " they darken too much in fog"))
    return [{"stage": stage, "text": text} for stage, text in found]


def light_rows(illumination: dict[str, Any], gains: dict[str, float]) -> list[dict[str, Any]]:
    """One row a light: strength (3,), standard error, unit, and a swatch of its colour."""
    rows = []
    for name, light in illumination["lights"].items():
        strength = np.asarray(light["strength"], float)
        tint = displayed((strength / max(strength.max(), 1e-300))[None, None])[0, 0]
        error = light.get("standard_error")
        uncertain = light["source"] != "given" and error is not None
        rows.append({"name": name, **light, "gain": gains[name], "swatch": "#%02x%02x%02x" % tuple(int(x) for x in tint),
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
    with np.errstate(divide="ignore"):
        visibility = -np.log(0.05) / extinction.mean()
    return {"type": medium.type, "absorption": absorption.tolist(), "scattering": scattering.tolist(),
            "extinction": extinction.tolist(), "visibility": float(visibility),
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


def plain(value: Any) -> Any:
    """The same in JSON's own terms, which know neither infinity nor NaN: those become words."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [plain(item) for item in value]
    if isinstance(value, (float, np.floating)):
        if math.isnan(value):
            return "nan"
        return float(value) if math.isfinite(value) else "infinity" if value > 0 else "-infinity"
    return value


# ---- files -------------------------------------------------------------------------------------

def _sha256(path: Path) -> str | None:
    if not path.is_file():
        return None
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _versions() -> dict[str, Any]:
    """Of everything that has a say in the result."""
    project = tomllib.loads((paths.PROJECT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    packages = {}
    for requirement in project["dependencies"]:
        name = re.match(r"[\w.-]+", requirement).group()
        packages[name] = metadata.version(name)
    try:
        renderer = povray.version()
    except InputError:
        renderer = None  # it was there when the pictures were made; the report can be made without
    return {"python": platform.python_version(), "povray": renderer, "packages": packages}


def _sources(build: Build, photograph: dict) -> dict[str, Any]:
    """SHA-256 of what went in: photograph, scene file, templates, and the .pov files made from them."""
    programs = sorted([*build.basis.glob("*.pov"), *build.pov.glob("*.pov")])
    marker = re.compile(r"^\s*// ---- (.*\.(?:inc|pov))$", re.M)
    markers = set()
    for pov in programs:
        markers |= set(marker.findall(pov.read_text(encoding="utf-8", errors="replace")))
    templates = {}
    for template in sorted(markers):
        path = paths.PROJECT / template  # or itself, where it is absolute
        templates[_template_name(build, path)] = _sha256(path)
    return {"photograph": {photograph["file"]: photograph["sha256"]},
            "scene": {"scene.yaml": _sha256(build.scene_file)}, "templates": templates,
            "pov": {_relative(build, pov): _sha256(pov) for pov in programs}}


def _template_name(build: Build, path: Path) -> str:
    """Without this machine's folders: in the project, in the scene's folder, or beside a plugin's module."""
    path = path.resolve()
    for folder, name in ((build.source.resolve(), f"scenes/{build.scene}"), (paths.PROJECT, "")):
        if path.is_relative_to(folder):
            return str(Path(name) / path.relative_to(folder))
    return f"{path.parent.name}/{path.name}"


def _stage_seconds(build: Build) -> dict[str, float]:
    """Seconds of each stage's last run; the shared stages may have run for another fog of the scene."""
    found = {}
    for stage in (*SHARED_STAGES, *FOG_STAGES):
        folders = [build.seconds] + [build.shared / "inputs" / "seconds"] * (stage in SHARED_STAGES)
        files = [folder / f"{stage}.json" for folder in folders if (folder / f"{stage}.json").exists()]
        if files:
            found[stage] = read_json(max(files, key=lambda f: f.stat().st_mtime))
    return found


def _run_seconds(build: Build, plan: dict) -> dict[str, float]:
    """Seconds of each POV-Ray run, by the stamp beside its image."""
    stamps = sorted(build.basis.glob("*.sha256")) + [build.runs / f"{r['id']}.sha256" for r in plan["runs"]]
    seconds = {}
    for stamp in stamps:
        words = stamp.read_text(encoding="utf-8").split() if stamp.exists() else []
        if len(words) >= 2:
            seconds[stamp.stem] = float(words[1])
    return seconds


def _results(build: Build, artefacts: dict[str, Any]) -> dict[str, Path]:
    """Every file that a person may want, by what it is."""
    plan, suffix = artefacts["plan"], artefacts["facts"]["suffix"]
    files = {"foggy photograph, PNG": build.foggy(".png"),
             "foggy photograph, linear EXR": build.foggy(".exr")}
    if suffix not in (".png", ".exr"):
        files[f"foggy photograph, {suffix[1:].upper()} like the original"] = build.foggy(suffix)
    if not plan["fog_is_clear"]:
        files |= {"transmittance map T": build.transmittance,
                  "in-scattering map V, all lights": build.in_scattering()}
        files |= {f"V of {light}": build.in_scattering(light) for light in plan["lights"]}
    return files | {
        "depth": build.depth, "clear photograph, linear EXR": build.photograph, "albedo": build.albedo,
        "overlay": build.overlay, "camera": build.camera, "geometry": build.geometry,
        "sun direction": build.sun_direction, "light strengths": build.illumination, "plan": build.plan}


def _relative(build: Build, path: Path) -> str:
    """From the report's folder."""
    return Path(os.path.relpath(path, build.out)).as_posix()


def _outputs(build: Build, artefacts: dict[str, Any]) -> dict[str, Any]:
    return {_relative(build, path): {"content": what, "sha256": _sha256(path), "bytes": path.stat().st_size}
            for what, path in _results(build, artefacts).items() if path.exists()}


def _links(build: Build, artefacts: dict[str, Any]) -> dict[str, list[dict[str, str]]]:
    def link(what, path):
        return {"text": what, "href": quote(_relative(build, path)), "name": _relative(build, path)}

    programs = [*sorted(build.pov.glob("*.pov")), *sorted(build.basis.glob("*.pov"))]
    return {"results": [link(what, path) for what, path in
                        {**_results(build, artefacts), "manifest": build.manifest}.items() if path.exists()],
            "pov": [link(path.stem, path) for path in programs]}


# ---- the page ----------------------------------------------------------------------------------

def number(value: Any, digits: int = 3) -> str:
    """`value` to so many digits as a person writes it; a dash for None."""
    if value is None:
        return "–"
    value = float(value)
    if not math.isfinite(value):
        return "∞" if value > 0 else "–"
    if value != 0 and not 1e-4 <= abs(value) < 1e6:
        return f"{value:.{digits - 1}e}"
    text = np.format_float_positional(value, digits, unique=False, fractional=False, trim="-")
    return text.replace("-", "−")


def numbers(values: Any, digits: int = 3) -> str:
    """Three channels, or one number where they agree."""
    texts = [number(v, digits) for v in values]
    return texts[0] if len(set(texts)) == 1 else ", ".join(texts)


def page(build: Build, **values: Any) -> str:
    """The text of templates/report.html, or of the scene's own, which wins; a mistake in it is one line."""
    environment = SandboxedEnvironment(
        loader=jinja2.FileSystemLoader([build.source / "templates", build.source, paths.TEMPLATES]),
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters |= {"number": number, "numbers": numbers}
    template = None
    try:
        template = environment.get_template("report.html")
        return template.render(build=build, **values)
    except jinja2.TemplateSyntaxError as error:
        raise InputError(f"template does not parse ({error.message})", remedy="mend this line",
                         place=f"{error.filename}:{error.lineno}") from None
    except (jinja2.UndefinedError, jinja2.exceptions.SecurityError) as error:
        raise InputError(f"template fails ({error})", place=template.filename if template else "report.html",
                         remedy="use the values that are there") from None
