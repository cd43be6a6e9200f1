"""Scene file and overrides -> inputs/*.json, each part touched only when it changed.

Make compares time stamps: a stage depends on its own part of the scene, so that a change of the fog
redoes no geometry, and a change of a light's strength renders nothing.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

from pipeline.errors import InputError
from pipeline.paths import Build, inside
from pipeline.plugins.base import Model
from pipeline.scene.artefacts import write_json_if_changed
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
        "shapes": {name: shape.model_dump(mode="json") for name, shape in scene.shapes.items()},
        "lights": lights,
        "strengths": strengths,
        "gains": gains,
        "illumination": scene.illumination.model_dump(mode="json"),
        "sun_direction": scene.sun_direction.model_dump(mode="json"),
        "fog": scene.fog.model_dump(mode="json"),
        "render": scene.render.model_dump(mode="json"),
    }
    if scene.camera.fspy:
        parts["camera"]["fspy_sha256"] = _sha256(inside(build, scene.camera.fspy, fspy_at), fspy_at)
    for part, value in parts.items():
        write_json_if_changed(build.input(part), value)
    # later stages say in which line of the scene file stands what they cannot use; nothing is made from this
    write_json_if_changed(build.lines, {".".join(keys): line for keys, line in text.lines.items()
                                        if all(isinstance(key, str) for key in keys)})
    return scene


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
