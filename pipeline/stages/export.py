"""Writes the scene in another program's language -> export/EXPORTER/*.

`foggy` has surfaces, lights and fog; in_scattering_LIGHT and transmittance_LIGHT, clear_LIGHT are each light's V and T.
"""

from __future__ import annotations

import sys
from dataclasses import replace

from pipeline.errors import InputError, nearest
from pipeline.imaging.atomic import replacing
from pipeline.paths import Build
from pipeline.plugins.registry import registry
from pipeline.rendering.describe import describe
from pipeline.scene.artefacts import read_fog, read_json, read_placed, read_strengths


def run(build: Build, to: str, size: int | None = None) -> None:
    exporters = registry("exporters")
    if to not in exporters:
        raise InputError(f"no exporter is called '{to}'", place="to=",
                         remedy=f"use one of {', '.join(sorted(exporters))}" + nearest(to, list(exporters)))
    if not exporters[to].states:
        print(f"done: {build.pov} (the chain's own files)")
        return
    exporter, scene, medium = exporters[to](), read_placed(build), read_fog(build)
    albedos = read_json(build.illumination)["face_albedo"]
    lights, strengths = read_json(build.plan)["lights"], read_strengths(build)
    if size and max(scene.camera.width, scene.camera.height) > size:
        share = size / max(scene.camera.width, scene.camera.height)
        scene = replace(scene, camera=scene.camera.resized(max(1, round(scene.camera.width * share)),
                                                           max(1, round(scene.camera.height * share))))
    renders = [("foggy", "foggy", lights)] + [
        (f"{what}_{name}", what, [name]) for name in lights if scene.lights[name].type_name() in exporter.states
        and scene.rendered(name) for what in ("in_scattering", "transmittance", "clear")]
    folder = build.export(to)
    folder.mkdir(parents=True, exist_ok=True)
    for name, what, shown in renders:
        description = describe(what, scene, medium, strengths, shown, albedos, exporter)
        for line in description.left_out:
            print(f"  {name}: left out: {line}", file=sys.stderr)
        for file, content in exporter.export(name, description).items():
            with replacing(folder / file) as partial:
                partial.write_bytes(content.encode() if isinstance(content, str) else content)
    print(f"done: {folder}")
