"""Light from all sides in fog between houses: shares known in closed form, a furnace, and a street through the stages."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.estimation.fog_surroundings import SKY, THING, about, fog_surroundings
from pipeline.estimation.surroundings import Surroundings
from pipeline.geometry.camera import from_field_of_view
from pipeline.geometry.raycast import first_hits
from pipeline.imaging.maps import read_map, write_map
from pipeline.physics import airlight, hidden_sky
from pipeline.plugins.registry import registry
from pipeline.scene.artefacts import read_json
from tests.test_surroundings import STREET, street

CAMERA = from_field_of_view(48, 48, 60, camera_height=1.6)
GROUND = 0
#: 200 rays of unequal weight know a share of the sphere to a few hundredths.
RAYS = 0.03


def seen(faces, colours, lamps=None):
    """What fog sees between faces of these colours (n + 1, 3), the last one the sky's."""
    depth, face = first_hits(CAMERA.position, CAMERA.directions(CAMERA.pixel_centres()), faces)
    depth = np.minimum(depth, 1000.0)
    around = Surroundings(CAMERA, lambda origin, rays: [hit[0] for hit in first_hits(origin, rays[None], faces)],
                          np.asarray(colours)[face], depth, face, lamps)
    return fog_surroundings(CAMERA, around, [GROUND], 2 * len(faces)), depth


def fog(visibility, asymmetry=0.0):
    return registry("media")["homogeneous"](
        type="homogeneous", visibility=visibility,
        phase_function={"type": "henyey_greenstein", "asymmetry": asymmetry})


@pytest.mark.parametrize("asymmetry", [-0.4, 0.0, 0.7, 0.95])
def test_weights_are_the_phase_function(asymmetry):
    """Their sums over the halves of the sphere are what the exact table of skylight says."""
    medium = fog(100, asymmetry)
    rays = CAMERA.directions(np.array([[[24.0, 2.0], [24.0, 24.0], [2.0, 46.0]]]))
    directions, angles = about(np.array([0.0, 0.0, -1.0]), 160)
    assert angles.sum() == pytest.approx(4 * np.pi, rel=0.02)
    weight = hidden_sky.weights(medium.phase(), rays, directions, angles)
    assert weight.sum(-1) == pytest.approx(np.ones((1, 3)))
    above = weight[..., directions[:, 1] > 0].sum(-1)
    assert above == pytest.approx(airlight.clear_skylight(medium.phase(), rays[..., 1]), abs=0.06)


@pytest.mark.parametrize("half_width, height", [(6, 9), (4, 30), (25, 5)])
def test_sky_between_two_long_walls(half_width, height):
    """In an endless street the middle at height h sees a wedge of the sky, 2 atan(D / (H - h)) of 180 degrees wide."""
    colours = np.array([[0.2, 0.2, 0.2], [0.5, 0.4, 0.3], [0.5, 0.4, 0.3], [1, 1, 1.0]])
    found, _ = seen(street(half_width, height), colours)
    kinds, at = found.kind, (found.kind.shape[0] // 2, found.kind.shape[1] // 2, 2)
    level = kinds[at]
    above = found.directions[:, 1] > 0
    share = found.solid_angles[above & (level == SKY)].sum() / found.solid_angles[above].sum()
    coarse = CAMERA.resized(*kinds.shape[1::-1])
    ray = coarse.directions(coarse.pixel_centres())[at[:2]]
    x, y, _ = CAMERA.position + found.distances[at[2]] * ray
    wedge = np.arctan((half_width - x) / (height - y)) + np.arctan((half_width + x) / (height - y))
    assert share == pytest.approx(wedge / np.pi, abs=RAYS)
    things = found.radiance[found.kind == THING]
    assert things == pytest.approx(np.broadcast_to(colours[1], things.shape), abs=0.15), "averaged with what is beside them"


@pytest.mark.parametrize("asymmetry", [0.0, 0.7, 0.9])
@pytest.mark.parametrize("visibility", [10, 100, 1e5])
def test_furnace(visibility, asymmetry):
    """Sky, ground and walls of one radiance: whatever hides what, fog that absorbs nothing lets all of it look the same."""
    radiance = np.array([0.5, 0.6, 0.8])
    found, _ = seen(street(6, 12), np.tile(radiance, (4, 1)))
    medium, eye = fog(visibility, asymmetry), CAMERA.position
    coarse = CAMERA.resized(found.kind.shape[1], found.kind.shape[0])
    inside = coarse.directions(coarse.pixel_centres())
    weight = hidden_sky.weights(medium.phase(), inside, found.directions, found.solid_angles)
    above = found.directions[:, 1] > 0
    share = airlight.clear_skylight(medium.phase(), inside[..., 1])[..., None]
    things = np.where((found.kind == THING)[..., None], found.radiance, 0)
    sky = hidden_sky.left_of(weight, above, found.kind == SKY) + hidden_sky.instead(weight, things, share * radiance)
    ground = np.repeat(hidden_sky.left_of(weight, ~above, found.kind == 1), 3, -1)
    total = share[:, :, None] * sky + (1 - share)[:, :, None] * ground
    # directions are coarser than a narrow peak, and so is the split at the horizon
    assert total == pytest.approx(np.ones_like(total), abs=0.12)
    assert np.sqrt(np.mean((total - 1) ** 2)) < 0.03
    end = np.full((*inside.shape[:2], 1, 3), 1.0)
    mean = hidden_sky.along_rays(medium, eye, inside, np.full(inside.shape[:2], 50.0), found.distances,
                                 np.concatenate([total, end], 2))
    assert np.sqrt(np.mean((mean - 1) ** 2)) < 0.03


@pytest.mark.parametrize("depth", [0.0, 1e-9, 30.0, 1e7])
@pytest.mark.parametrize("visibility", [1e-2, 30, 1e7])
def test_means_along_rays_stay_means(depth, visibility):
    """Of values from 1 to 2, at any density and depth, also where nothing scatters."""
    rays = CAMERA.directions(CAMERA.pixel_centres())[::12, ::12]
    values = np.linspace(1, 2, 5)[None, None, :, None] * np.ones((*rays.shape[:2], 1, 3))
    found = hidden_sky.along_rays(fog(visibility), CAMERA.position, rays, np.full(rays.shape[:2], depth),
                                  np.array([1.0, 3.0, 10.0, 30.0]), values)
    assert np.isfinite(found).all() and found.min() >= 1 - 1e-12 and found.max() <= 2 + 1e-12
    if visibility == 1e-2 or depth <= 1e-9:
        assert found == pytest.approx(np.ones_like(found)), "all the light comes from before the first point"
    if visibility == 1e7 and depth == 1e7:
        assert found == pytest.approx(np.full_like(found, 2), abs=1e-3), "nearly all of it comes from beyond the last"


def test_lamps_in_the_picture_are_not_thrown_back():
    colours = np.array([[0.2, 0.2, 0.2], [0.5, 0.5, 0.5], [0.5, 0.5, 0.5], [1, 1, 1.0]])
    lamps = np.zeros((48, 48), bool)
    lamps[10:20, 3:9] = True
    dark, _ = seen(street(6, 12), colours)
    faces = street(6, 12)
    depth, face = first_hits(CAMERA.position, CAMERA.directions(CAMERA.pixel_centres()), faces)
    photograph = np.where(lamps[..., None], 1000, colours[face])
    around = Surroundings(CAMERA, lambda origin, rays: [hit[0] for hit in first_hits(origin, rays[None], faces)],
                          photograph, np.minimum(depth, 1000), face, lamps)
    lit = fog_surroundings(CAMERA, around, [GROUND], 10)
    assert lit.radiance.max() <= dark.radiance.max() + 1e-9


def test_nothing_upright():
    assert seen(street(6, 0), np.array([[0.2, 0.2, 0.2], [1, 1, 1.0]]))[0] is None


LIGHTS = "lights:\n  sky: {type: sky, radiance: [1, 1, 1]}\n  ground: {type: ground, radiance: [0.2, 0.2, 0.2]}\n"
CHAIN = ("resolve", "photograph", "camera", "geometry", "sun_direction", "illumination", "plan", "emit", "render", "decompose")


def test_street_through_the_stages(tiny_scene):
    """Black houses: V of sky and ground is less than without them; told that nothing stands there, it is as without."""
    file = STREET.replace("lights:\n  sky: {type: sky}\n", LIGHTS)
    tiny_scene.file.write_text(file)
    write_map(tiny_scene.folder / "photograph.exr", np.full((64, 96, 3), 1e-4, np.float32))
    assert tiny_scene.run(*CHAIN) == 0
    build = tiny_scene.build
    facts = read_json(build.illumination)["surroundings"]
    assert 0.3 < facts["sky_seen"] < 0.95
    hidden = {name: read_map(build.in_scattering(name)) for name in ("sky", "ground")}
    hits = read_map(build.surrounding_hits)
    assert set(np.unique(hits[..., 0])) == {0, 1, 2} and read_map(build.surroundings).shape == hits.shape
    assert facts["room"] is None and not build.room.exists(), "no room"
    tiny_scene.file.write_text(file.replace("[1, 1, 1]", "[1, 1, 1], unobstructed: true").replace(
        "[0.2, 0.2, 0.2]}\nill", "[0.2, 0.2, 0.2], unobstructed: true}\nill"))
    assert tiny_scene.run(*CHAIN) == 0
    assert not build.surroundings.exists() and read_json(build.illumination)["surroundings"] is None
    for name, dark in hidden.items():
        free = read_map(build.in_scattering(name))
        assert (dark <= free * (1 + 1e-4)).all() and 0.3 < dark.sum() / free.sum() < 0.97, name
