"""What a result was made from, with which versions, in what time; and the files that there are."""

from __future__ import annotations

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

import numpy as np

from pipeline import __version__, paths
from pipeline.errors import InputError
from pipeline.paths import Build
from pipeline.rendering import povray
from pipeline.scene.artefacts import FOG_STAGES, read_json

SHARED_STAGES = ("photograph", "camera", "geometry", "sun_direction", "illumination")


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


def manifest_of(build: Build, artefacts: dict[str, Any], parameters: dict[str, Any],
                seconds: dict[str, Any], errors: dict[str, Any], planned: dict[str, Any] | None) -> dict[str, Any]:
    """All that the manifest says, in JSON's terms; files are named from the manifest's folder."""
    return plain({
        "project": {"name": "fog-into-photographs", "version": __version__}, "scene": build.scene,
        "fog": build.fog or "default", "versions": _versions(),
        "sources": _sources(build, parameters["photograph"]), "parameters": parameters,
        "plan": planned, "seconds": seconds, "estimated_error": errors,
        "povray_warnings": _povray_warnings(build), "outputs": _outputs(build, artefacts)})


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


def _povray_warnings(build: Build) -> list[str]:
    """Each once, of all renders that went into the result."""
    found = {}
    for pov in (*sorted(build.basis.glob("*.pov")), *sorted(build.pov.glob("*.pov"))):
        folder = build.runs if pov.parent == build.pov else pov.parent
        found |= dict.fromkeys(povray.warnings_beside(folder / pov.name, pov))
    return [text.replace(f"{paths.PROJECT}/", "") for text in found]


def _sha256(path: Path) -> str | None:
    if not path.is_file():
        return None
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _template_name(build: Build, path: Path) -> str:
    """Without this machine's folders: in the project, in the scene's folder, or beside a plugin's module."""
    path = path.resolve()
    for folder, name in ((build.source.resolve(), f"scenes/{build.scene}"), (paths.PROJECT, "")):
        if path.is_relative_to(folder):
            return str(Path(name) / path.relative_to(folder))
    return f"{path.parent.name}/{path.name}"


def stage_seconds(build: Build) -> dict[str, float]:
    """Seconds of each stage's last run; the shared stages may have run for another fog of the scene."""
    found = {}
    for stage in (*SHARED_STAGES, *FOG_STAGES):
        folders = [build.seconds] + [build.shared / "inputs" / "seconds"] * (stage in SHARED_STAGES)
        files = [folder / f"{stage}.json" for folder in folders if (folder / f"{stage}.json").exists()]
        if files:
            found[stage] = read_json(max(files, key=lambda f: f.stat().st_mtime))
    return found


def run_seconds(build: Build, plan: dict) -> dict[str, float]:
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


def _outputs(build: Build, artefacts: dict[str, Any]) -> dict[str, Any]:
    return {_relative(build, path): {"content": what, "sha256": _sha256(path), "bytes": path.stat().st_size}
            for what, path in _results(build, artefacts).items() if path.exists()}


def links(build: Build, artefacts: dict[str, Any]) -> dict[str, list[dict[str, str]]]:
    def link(what, path):
        return {"text": what, "href": quote(_relative(build, path)), "name": _relative(build, path)}

    programs = [*sorted(build.pov.glob("*.pov")), *sorted(build.basis.glob("*.pov"))]
    return {"results": [link(what, path) for what, path in
                        {**_results(build, artefacts), "manifest": build.manifest}.items() if path.exists()],
            "pov": [link(path.stem, path) for path in programs]}


def _relative(build: Build, path: Path) -> str:
    """From the report's folder."""
    return Path(os.path.relpath(path, build.out)).as_posix()
