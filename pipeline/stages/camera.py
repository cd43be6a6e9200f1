"""Camera annotations -> camera.json."""

from __future__ import annotations

from pipeline.errors import InputError
from pipeline.paths import Build
from pipeline.scene.artefacts import camera_to_json, read_json, scene_place, write_json
from pipeline.scene.described_camera import describe
from pipeline.scene.model import CameraDescription


def run(build: Build) -> None:
    facts = read_json(build.photograph_facts)
    data = read_json(build.input("camera"))
    data.pop("fspy_sha256", None)
    try:
        camera, report = describe(CameraDescription.model_validate(data), facts["width_pixel"],
                                  facts["height_pixel"], facts["focal_length_35mm_mm"], build)
    except InputError as error:
        raise error.at(scene_place(build, "camera")) from None
    write_json(build.camera, {**camera_to_json(camera), **report})
