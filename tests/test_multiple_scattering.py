"""How far single scattering plus an ambient light is from all orders of scattering, in a closed room.

Reference: `tests/reference/multiple_scattering/`, an independent path tracer (Mitsuba 3).
"""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from pipeline.imaging.maps import read_map, write_map
from pipeline.paths import Build
from pipeline.planning.accuracy import relative_error
from pipeline.scene.artefacts import read_json
from tests.reference.path_tracer import SHARES, Fog, trace
from tests.test_light_transport import DESCRIBED, run
from tests.test_path_tracer import closed_room

REFERENCE = Path(__file__).parent / "reference" / "multiple_scattering"


def foggy(folder, scattering, lights, render=None) -> tuple[np.ndarray, np.ndarray]:
    """The foggy photograph (H, W, 3) of the reference's clear one, and where it shows no lamp."""
    build = Build("room", None, folder / "scenes", folder / "build")
    build.source.mkdir(parents=True)
    write_map(build.source / "photograph.exr", read_map(REFERENCE / "clear.exr"))
    build.scene_file.write_text(json.dumps({
        "photograph": {"file": "photograph.exr"},
        "camera": {"position": [0.03, 1.43, 1.3], "look_at": [0.02, 1.1, -2], "horizontal_field_of_view": 65},
        "shapes": {"room": {"type": "room", "lower": [-1.5, 0, -3], "upper": [1.5, 2.4, 1.6]}}, "lights": lights,
        "render": render or {},
        "fog": {"type": "homogeneous", "absorption_coefficient": [0, 0, 0], "scattering_coefficient": [scattering] * 3,
                "phase_function": {"type": "isotropic"}}}))
    run(build)
    return read_map(build.foggy(".exr")), read_map(build.surfaces)[..., 1] < 0


LAMP = {**DESCRIBED["area"], "radiance": [17.0, 12.0, 7.0]}


@pytest.mark.parametrize("scattering", [0.1, 0.3])
def test_ambient_light_stands_for_what_single_scattering_leaves_out(tmp_path, scattering):
    true = read_map(REFERENCE / f"fog_{scattering}.exr")
    ours, surface = foggy(tmp_path / "with", scattering, {"lamp": LAMP, "reflected": {"type": "ambient"}})
    # 512 samples a pixel leave 1 % in a median
    assert abs(np.median(ours[surface] / true[surface]) - 1) < 0.05
    away = cv2.erode(surface.astype(np.uint8), np.ones((3, 3)))[..., None]  # pixels at the lamp's rim show some of it
    blocks = [(away * image).reshape(6, 6, 8, 6, 3).sum((1, 3)) for image in (ours, true)]
    # measured: 1.3 and 2.2 %, worst 5 %; by a uniform field, as an ambient light is elsewhere, 2.8 and 7.5 %, worst 18 %
    off = blocks[0] / blocks[1] - 1
    assert np.sqrt((off**2).mean()) < 0.03 and np.abs(off).max() < 0.07
    papers, _ = foggy(tmp_path / "without", scattering, {"lamp": LAMP})
    assert np.median(papers[surface] / true[surface]) < 0.75, "without it fog only darkens a room"


def test_fewer_directions_in_a_room_know_the_same_light_less_well(tmp_path):
    """By less the more there are, as a plan expects; and the estimate counts what its pixels cannot tell."""
    lights, off, told = {"lamp": LAMP, "reflected": {"type": "ambient"}}, [], []
    pictures = {}
    for count in (128, 64, 32):
        pictures[count], surface = foggy(tmp_path / str(count), 0.3, lights, {"room_directions": count})
        build = Build("room", None, tmp_path / str(count) / "scenes", tmp_path / str(count) / "build")
        expected, estimate = read_json(build.plan)["expected"], read_json(build.maps)["estimated_error"]
        assert estimate["shared"] == expected["relative_error_by"]["room_directions"] <= estimate["relative_error"]
        told.append(estimate["shared"])
        off.append(relative_error(pictures[count][surface], pictures[128][surface]))
    assert told[0] == 0 < told[1] < told[2] and 0 < off[1] < off[2] < 0.05
    assert off[1] < 2 * told[1] and off[2] < 2 * told[2]


def test_what_surfaces_send_and_what_fog_scatters_again(tmp_path):
    """Each for itself, in sums over the picture: they do not make up for one another."""
    _, surface = foggy(tmp_path, 0.3, {"lamp": LAMP, "reflected": {"type": "ambient"}})
    away = cv2.erode(surface.astype(np.uint8), np.ones((3, 3))) > 0
    room, out = closed_room(), tmp_path / "build/room"
    rays = room.rays(48, 36)
    sent, scattered = (trace(room, rays, Fog(0.0, 0.3), 64, 5, (start,)).reshape(len(SHARES), 36, 48, 3)[:, away].sum(1)
                       for start in ("surface", "fog"))
    surfaces = (read_map(out / "transmittance.exr") * read_map(REFERENCE / "clear.exr"))[away].sum(0)
    # of that noise is 0.5 %
    assert surfaces == pytest.approx(sent.sum(0), rel=0.015)
    once = SHARES.index("single")
    assert read_map(out / "in_scattering_lamp.exr")[away].sum(0) == pytest.approx(scattered[once], rel=0.015)
    again = np.delete(scattered, once, 0).sum(0)
    assert read_map(out / "in_scattering_reflected.exr")[away].sum(0) == pytest.approx(again, rel=0.04)
