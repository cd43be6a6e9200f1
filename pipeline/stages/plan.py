"""Fog, lights and geometry -> plan.json: which renders are needed, how fine, and why."""

from __future__ import annotations

from pipeline.paths import Build
from pipeline.rendering.runs import as_json, fog_runs
from pipeline.scene.artefacts import read_fog, read_json, read_placed, write_json


def run(build: Build) -> None:
    scene, medium = read_placed(build), read_fog(build)
    settings = read_json(build.input("render"))
    reasons: list[str] = []
    if medium.is_clear():
        lights: list[str] = []
        reasons.append("the fog extinguishes nothing: no render, the photograph comes back unchanged")
    else:
        strengths = read_json(build.illumination)["lights"]
        lights = [name for name in scene.lights if max(strengths[name]["strength"]) > 0]
        reasons += [f"{name}: strength 0, no render" for name in scene.lights if name not in lights]
    sizes = settings["samples"], settings["in_scattering_size"]
    runs = fog_runs(scene, medium, lights, *sizes) if lights else []
    if lights:
        absorption, scattering = medium.coefficients()
        if not scattering.max() > 0:
            reasons.append("the fog scatters nothing: no in-scattering renders, V = 0")
        samples = max((r.samples for r in runs), default=0)
        if samples > settings["samples"]:
            reasons.append(f"dense fog: {samples} samples instead of {settings['samples']}, a third of an"
                           " optical depth each")
        if not any(light.type == "sun" for light in scene.lights.values()):
            reasons.append("no sun: no shaft")
    write_json(build.plan, {
        "fog_is_clear": medium.is_clear(), "lights": lights, "runs": [as_json(r) for r in runs],
        "reasons": reasons})
