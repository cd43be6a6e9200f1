"""What lights a patch besides sun and sky: view factors known in closed form, and a street through the stages."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.cli import main
from pipeline.estimation.surroundings import Surroundings
from pipeline.geometry.camera import Camera, from_field_of_view
from pipeline.geometry.raycast import first_hits
from pipeline.imaging.maps import write_map
from pipeline.paths import PROJECT
from pipeline.scene.artefacts import read_json
from tests.test_daylight import BEFORE, SKY

UP = np.array([0.0, 1.0, 0.0])
GROUND, WALLS = np.array([0.1, 0.1, 0.12]), np.array([0.3, 0.25, 0.2])
#: A sunflower of 192 rays knows a share of the hemisphere to about one of a hundred.
RAYS = 0.012


def street(half_width, height, length=2000.0):
    """Faces of the ground and of two walls along z, at x = +-half_width."""
    def wall(x):
        return np.array([[x, 0, -length], [x, 0, length], [x, height, length], [x, height, -length]])

    ground = length * np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1.0]])
    return [ground, wall(-half_width), wall(half_width)] if height else [ground]


def around(point, normal, faces, *, camera=None):
    """Surroundings of a point, the photograph showing ground and walls in their colours."""
    camera = camera or from_field_of_view(64, 64, 90, camera_height=1.6)
    depth, face = first_hits(camera.position, camera.directions(camera.pixel_centres()), faces)
    colours = np.array([GROUND, WALLS, WALLS, SKY])
    return Surroundings(camera, lambda origin, directions: [hit[0] for hit in first_hits(origin, directions[None], faces)],
                        colours[face], depth, face).of_patch(np.asarray(point, float)[None], np.asarray(normal, float))


def test_open_plain_shows_all_of_the_sky():
    found = around([0, 0, -9], UP, street(5, 0))
    assert found.sky == 1 and found.unseen == 0 and found.reflected.tolist() == [0, 0, 0]


def test_wall_on_an_open_plain_sees_half_sky_half_ground():
    found = around([0, 1.5, -9], [0, 0, 1], street(5, 0))
    assert found.sky == pytest.approx(0.5, abs=RAYS)
    # 1 % of the rays run on over the ground's edge
    assert found.reflected == pytest.approx(0.5 * GROUND, rel=0.05)


@pytest.mark.parametrize("half_width, height", [(5, 5), (5, 20), (20, 5)])
def test_ground_between_two_long_walls(half_width, height):
    """From the middle of an endless street the sky is D / sqrt(D^2 + H^2) of pi L: Nusselt's analogue in the plane."""
    found = around([0, 0, -9], UP, street(half_width, height))
    share = half_width / np.hypot(half_width, height)
    assert found.sky == pytest.approx(share, abs=2 * RAYS)
    assert found.reflected == pytest.approx((1 - found.sky) * WALLS, rel=1e-6)
    assert 0 < found.unseen < 1 - found.sky, "a part of the walls lies behind the camera, taken as bright as the rest"


def test_rays_that_are_cut_off_near_the_patch():
    """A patch at the foot of a wall sees half of the sky, wherever the camera stands."""
    faces = street(5, 400)[:2]
    found = around([-4.99, 0, -9], UP, faces)
    assert found.sky == pytest.approx(0.5, abs=0.03), "rays begin 1 % of the distance, 9 cm, above the ground"


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_unit_of_length_does_not_matter(scale):
    camera = from_field_of_view(64, 64, 90, camera_height=1.6)
    other = Camera(64, 64, camera.focal_length, camera.principal_point, camera.world_from_camera, camera.position * scale)
    metres = around([0, 0, -9], UP, street(5, 8))
    found = around([0, 0, -9 * scale], UP, [face * scale for face in street(5, 8)], camera=other)
    assert found.sky == metres.sky and found.reflected == pytest.approx(metres.reflected)


STREET = """\
photograph: {file: photograph.exr}
camera: {horizontal_field_of_view: 60, pitch: 0, height: 1.6}
depth:
  sky_depth: 500
  refine: {radius: 0}
  regions:
    sky: {class: sky, pixels: [[0, 0], [96, 0], [96, 33], [0, 33]]}
    ground: {class: support, pixels: [[0, 33], [96, 33], [96, 64], [0, 64]]}
    left: {class: vertical, foot: [[0, 56], [44, 34]], pixels: [[0, 0], [44, 28], [44, 34], [0, 56]]}
    right: {class: vertical, foot: [[96, 56], [52, 34]], pixels: [[96, 0], [52, 28], [52, 34], [96, 56]]}
lights:
  sky: {type: sky}
illumination:
  type: liu_xing
  albedo: 0.2
  shadowed:
    - {pixels: [[36, 42], [60, 42], [64, 50], [32, 50]]}
fog: {type: homogeneous, visibility: 100}
"""
CRATE = "shapes:\n  crate: {type: cuboid, centre: [0, 0.5, 8], size: [3, 1, 1], albedo: [0.1, 0.1, 0.1]}\n"


def test_street_through_the_stages(tiny_scene):
    """Dark walls, and a crate of the scene's own, hide a third of the sky, which would come out a third too dark."""
    tiny_scene.file.write_text(STREET.replace("lights:", CRATE + "lights:"))
    image = np.broadcast_to(SKY, (64, 96, 3)).astype(np.float32)
    v, u = np.mgrid[:64, :96] + 0.5
    ground = (v > 33) & (v > 34 + 22 * np.abs(u - 48) / 44)
    image = np.where(((np.abs(u - 48) > 4) & (v > 28 - 28 * (np.abs(u - 48) - 4) / 44))[..., None], 1e-3, image)
    image[ground] = 0.2 * 0.7 * SKY
    write_map(tiny_scene.folder / "photograph.exr", image.astype(np.float32))
    assert tiny_scene.run(*BEFORE, "illumination") == 0
    found = read_json(tiny_scene.build.illumination)
    share = found["patches"]["shadowed[0]"]["sky_share"]
    assert 0.4 < share < 0.95
    assert found["lights"]["sky"]["strength"] == pytest.approx(SKY * 0.7 / share, rel=0.02), "0.02 of dark walls"


def test_building_has_the_light_that_it_was_made_with(tmp_path):
    """The stated goal: sun and sky within a tenth of the truth in every channel, from the linear photograph."""
    options = ["--scene", "building", "--scenes", str(PROJECT / "scenes"), "--build", str(tmp_path)]
    for stage in (*BEFORE, "illumination"):
        assert main([stage, *options, *(["--set", "photograph.file=photograph.exr"] if stage == "resolve" else [])]) == 0
    lights = read_json(tmp_path / "building/illumination.json")["lights"]
    truth = read_json(PROJECT / "scenes/building/truth.json")
    sun = np.array(lights["sun"]["strength"]) / truth["sun"]["irradiance_photo_unit_sr"]
    sky = np.array(lights["sky"]["strength"]) / truth["sky"]["radiance_photo_unit"]
    print(f"sun {sun.round(3)}, sky {sky.round(3)} of the truth")
    assert np.abs(sun - 1).max() < 0.1 and np.abs(sky - 1).max() < 0.1
