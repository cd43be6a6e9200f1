"""Windows and their sunlit patches -> sun_direction.json."""

from __future__ import annotations

import numpy as np

from pipeline.errors import InputError
from pipeline.estimation.sun_direction import Opening, estimate_sun_direction
from pipeline.paths import Build
from pipeline.plugins.lights.sun import Sun, shafts
from pipeline.scene.artefacts import plugin_from_json, read_camera, read_json, scene_place, write_json


def run(build: Build) -> None:
    camera = read_camera(build)
    settings = plugin_from_json("estimators", read_json(build.input("sun_direction")))
    suns = {}
    for name, data in read_json(build.geometry)["lights"].items():
        light = plugin_from_json("lights", data)
        if not isinstance(light, Sun):
            continue
        try:
            suns[name] = _direction(name, light, camera, settings)
            shafts(light.model_copy(update={"direction": suns[name]["sun_direction"]}))
        except InputError as error:
            raise error.at(scene_place(build, "lights", name)) from None
    write_json(build.sun_direction, {"suns": suns})


def _direction(name: str, sun: Sun, camera, settings) -> dict:
    if sun.direction is not None:
        for key, opening in sun.openings.items():
            _enters(name, key, np.asarray(sun.direction), opening)
        return {"sun_direction": sun.direction, "status": "given", "messages": []}
    openings = [Opening(key, o.window.polygon, [(p.polygon, None) for p in o.patches])
                for key, o in sun.openings.items()]
    estimate = estimate_sun_direction(camera, openings, starts=settings.starts, seed=settings.seed,
                                      noise=settings.annotation_noise)
    if estimate.status == "impossible":
        raise InputError(f"no sun direction explains the patches: {'; '.join(estimate.messages)}",
                         remedy="correct the window and patch polygons, or give the light a 'direction'")
    return {
        "sun_direction": estimate.sun_direction, "status": estimate.status, "objective": estimate.objective,
        "confidence_degree": estimate.confidence,
        "openings": {o.name: {"overlap": o.overlap, "angle_rms_degree": o.rms, "angle_max_degree": o.largest}
                     for o in estimate.openings},
        "alternatives": list(estimate.alternatives), "messages": [*estimate.messages, *estimate.notes]}


def _enters(name, key, direction, opening) -> None:
    from pipeline.geometry.planes import polygon_normal

    if polygon_normal(opening.window.polygon) @ direction <= 1e-3:
        raise InputError(f"{name}: direction {direction.tolist()} does not enter through window '{key}'",
                         remedy="let it point from the sun into the room")
