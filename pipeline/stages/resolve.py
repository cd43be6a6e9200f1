"""Scene file and overrides -> inputs/*.json, each part touched only when it changed.

Make compares time stamps: a stage depends on its own part of the scene, so that a change of the fog
redoes no geometry, and a change of a light's strength renders nothing.
"""

from __future__ import annotations

import hashlib
import inspect
from pathlib import Path

from pipeline.errors import InputError
from pipeline.ownership import claim
from pipeline.paths import PROJECT, Build, inside
from pipeline.plugins.base import Model
from pipeline.scene.artefacts import FORMAT, read_json, write_json, write_json_if_changed
from pipeline.scene.load import checked, read_scene, scenes_beside


def run(build: Build, overrides: dict[str, str]) -> Model:
    if not build.source.is_dir():
        raise InputError(f"no scene is called '{build.scene}'", place=str(build.source),
                         remedy=scenes_beside(build.source))
    text = read_scene(build.scene_file)
    scene = checked(text, overrides, build.fog)
    photograph_at, fspy_at = text.place(("photograph", "file")), text.place(("camera", "fspy"))
    photograph = inside(build, scene.photograph.file, photograph_at)
    lights = {name: light.model_dump(mode="json") for name, light in scene.lights.items()}
    # what relights is no business of the geometry, and a gain none of the estimate
    gains = {name: light.pop("gain") for name, light in lights.items()}
    strengths = {name: lights[name].pop(light.strength_name) for name, light in scene.lights.items()}
    parts = {
        "photograph": {**scene.photograph.model_dump(mode="json"),
                       "sha256": _sha256(photograph, photograph_at)},
        "camera": scene.camera.model_dump(mode="json"),
        "depth": _depth(build, scene, text),
        "shapes": {name: shape.model_dump(mode="json") for name, shape in scene.shapes.items()},
        "lights": lights,
        "strengths": strengths,
        "gains": gains,
        "illumination": scene.illumination.model_dump(mode="json"),
        "exporter": scene.exporter.model_dump(mode="json"),
        "sun_direction": scene.sun_direction.model_dump(mode="json"),
        "fog": scene.fog.model_dump(mode="json"),
        "fog_files": {name: _sha256(inside(build, name, text.place(("fog",))), text.place(("fog",)))
                      for name in scene.fog.files()},
        "fogs": {name: fog.model_dump(mode="json") for name, fog in scene.fogs.items()},
        "render": scene.render.model_dump(mode="json"),
        "composite": scene.composite.model_dump(mode="json"),
    }
    if scene.camera.fspy:
        parts["camera"]["fspy_sha256"] = _sha256(inside(build, scene.camera.fspy, fspy_at), fspy_at)
    parts["templates"], parts["plugins"] = _templates(build), _plugins(scene)
    claim(build)
    parts["demand"] = {"light_strengths": not scene.fog.is_clear() or _was_demanded(build)}
    # what another version wrote is made anew whatever its time stamps: a copy or a checkout makes them new
    write = write_json_if_changed if _is_current(build) else write_json
    for part, value in parts.items():
        write(build.input(part), value)
    write_json_if_changed(build.input("format"), FORMAT)
    # later stages say in which line of the scene file stands what they cannot use; nothing is made from this
    write_json_if_changed(build.lines, {".".join(keys): line for keys, line in text.lines.items()
                                        if all(isinstance(key, str) for key in keys)})
    return scene


def _is_current(build: Build) -> bool:
    """Whether this version made the scene's build folder; all fogs are newer than what they share."""
    stamp = build.input("format")
    return stamp.exists() and read_json(stamp) == FORMAT


def _depth(build: Build, scene: Model, text) -> dict | None:
    """The depth section, with the contents' hashes of the files that it names."""
    if scene.depth is None:
        return None
    at = text.place(("depth",))
    return {**scene.depth.model_dump(mode="json", by_alias=True),
            "sha256": {name: _sha256(inside(build, name, at), at) for name in scene.depth.files()}}


def _was_demanded(build: Build) -> bool:
    """Whether a fog of this scene needed the light strengths before: they are shared, and kept up to date."""
    demand = build.input("demand")
    return demand.exists() and read_json(demand)["light_strengths"]


def _templates(build: Build) -> dict[str, str]:
    """The scene's own templates by name: one that appears, changes or goes is noticed."""
    found = [inside(build, str(path.relative_to(build.source)))
             for pattern in ("*.inc", "*.pov", "report.html") for path in build.source.rglob(pattern)]
    return {str(path.relative_to(build.source)): _sha256(path, str(path)) for path in sorted(found)
            if path.is_file()}


def _plugins(scene: Model) -> dict[str, str]:
    """Sources of the scene's plugins from outside the project, which Make does not know."""
    used = [*scene.shapes.values(), *scene.lights.values(), scene.fog, scene.fog.phase(), scene.illumination,
            scene.sun_direction]
    files = {name for plugin in used for name in (
        Path(inspect.getfile(type(plugin))), plugin.template_folder() / f"{plugin.type_name()}.inc")}
    return {file.name: _sha256(file, str(file)) for file in sorted(files)
            if file.is_file() and not file.resolve().is_relative_to(PROJECT / "pipeline")}


def _sha256(path: Path, stated_at: str) -> str:
    try:
        with open(path, "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except FileNotFoundError:
        fetched = any((folder / "photograph.yaml").exists() for folder in path.parents[:2])
        hint = "run `make photos`, which fetches it" if fetched else "put the file there"
        raise InputError("no such file", place=str(path),
                         remedy=f"{hint}, or correct its name at {stated_at}") from None
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", place=str(path),
                         remedy=f"give a readable file at {stated_at}") from None
