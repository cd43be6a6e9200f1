"""Windows and their patches, shadows, or date and place -> sun_direction.json."""

from __future__ import annotations

from pipeline.errors import InputError
from pipeline.paths import Build
from pipeline.scene.artefacts import plugin_from_json, read_camera, read_json, scene_place, write_json
from pipeline.scene.described_sun import described_sun, is_sun, stated_at


def run(build: Build) -> None:
    camera = read_camera(build)
    settings = plugin_from_json("estimators", read_json(build.input("sun_direction")))
    suns = {}
    for name, data in read_json(build.geometry)["lights"].items():
        light = plugin_from_json("lights", data)
        if not is_sun(light):
            continue
        try:
            suns[name] = described_sun(name, light, camera, settings)
        except InputError as error:
            raise error.at(scene_place(build, *stated_at(name, light, settings))) from None
    write_json(build.sun_direction, {"suns": suns})
