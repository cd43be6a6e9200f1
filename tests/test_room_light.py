"""Light of all orders in a foggy room: patches and lattice, surfaces that no pixel shows, and light that is not lost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.estimation.fog_surroundings import fog_surroundings
from pipeline.estimation.room_light import VIEW_DIRECTIONS, of_view, room_light
from pipeline.estimation.surroundings import Surroundings
from pipeline.geometry.camera import from_field_of_view
from pipeline.geometry.lattice import lattice
from pipeline.geometry.patches import areas_and_normals, patches
from pipeline.geometry.raycast import first_hits
from pipeline.physics.fog_transport import Transport
from pipeline.plugins.registry import registry

LOW, HIGH = np.array([-1.5, 0.0, -3.0]), np.array([1.5, 2.4, 1.0])
CAMERA = from_field_of_view(64, 48, 70, camera_height=1.3)
ALBEDO = np.array([0.6, 0.5, 0.4])
STRENGTH = np.array([17.0, 12.0, 7.0])
#: A few hundred rays of 300 patches know a mean to this share.
RAYS = 0.05


def box(low, high) -> list[np.ndarray]:
    faces = []
    for axis in range(3):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        for side in (low, high):
            corners = np.empty((4, 3))
            corners[:, axis] = side[axis]
            corners[:, i], corners[:, j] = np.array([low, high, high, low])[:, i], np.array([low, low, high, high])[:, j]
            faces.append(corners)
    return faces


def lamp(**more):
    corners = [[-0.25, 2.39, -1.7], [0.25, 2.39, -1.7], [0.25, 2.39, -1.3], [-0.25, 2.39, -1.3]]
    return registry("lights")["area"].model_validate(
        {"type": "area", "outline": {"points": corners}, "faces_towards": [0, 1, -1.5], "radiance": STRENGTH.tolist(), **more})


def fog(scattering, absorption=0.0, asymmetry=0.0):
    return registry("media")["homogeneous"].model_validate({
        "type": "homogeneous", "absorption_coefficient": [absorption] * 3, "scattering_coefficient": [scattering] * 3,
        "phase_function": {"type": "henyey_greenstein", "asymmetry": asymmetry}})


def seen(faces, lamps, shown):
    """The view and the room, of a photograph that is `shown` of points (h, w, 3) [m] on faces (h, w)."""
    rays = CAMERA.directions(CAMERA.pixel_centres())
    depth, face = first_hits(CAMERA.position, rays, faces)
    photograph = shown(CAMERA.position + depth[..., None] * rays, face)
    around = Surroundings(CAMERA, lambda origin, rays: [hit[0] for hit in first_hits(origin, rays[None], faces)],
                          photograph, depth, face)
    found = fog_surroundings(CAMERA, around, [], 2 * len(faces), 1.0, VIEW_DIRECTIONS, True)
    return room_light(CAMERA, around, found, faces, lamps, {name: STRENGTH for name in lamps}, 2 * len(faces))


def transport(room, medium, lamps) -> Transport:
    return Transport(medium, room.within, room.beside, room.lit_by(lamps, {name: STRENGTH for name in lamps}),
                     room.lattice.nearest(), float(np.linalg.norm(HIGH - LOW)))


@pytest.fixture(scope="module")
def closed():
    """An empty room of one albedo, its photograph what a lamp and its reflections make of it."""
    faces, lamps = box(LOW, HIGH), {"lamp": lamp()}
    _, room = seen(faces, lamps, lambda points, face: np.broadcast_to(ALBEDO, points.shape))
    one = room.lit_by(lamps, {"lamp": STRENGTH})[0]
    own = one.on(room.patches.points, room.patches.normals, np.arange(len(room.patches.points)))[0]
    light = own
    for _ in range(60):
        light = own + room.beside.mean(np.where(room.beside.patch[..., None] >= 0, ALBEDO * light[room.beside.patch], 0))
    normals = areas_and_normals(faces)[1]

    def shown(points, face):
        towards = normals[face] * np.sign((normals[face] * (CAMERA.position - points)).sum(-1, keepdims=True))
        index, weight = room.patches.between(points, towards)
        return ALBEDO * np.einsum("...k,...kc->...c", weight, light[index])

    return seen(faces, lamps, shown), light, lamps


# ---- patches and points ------------------------------------------------------------------------------

def test_patches_fill_their_faces():
    cut = patches(box(LOW, HIGH), 300)
    assert 250 < len(cut.points) < 350
    area = 2 * (3 * 2.4 + 2.4 * 4 + 3 * 4)
    assert len(cut.points) * cut.spacing**2 == pytest.approx(area, rel=0.1)
    on_a_face = np.isclose(cut.points, LOW).any(-1) | np.isclose(cut.points, HIGH).any(-1)
    assert on_a_face.all() and (cut.points >= LOW - 1e-9).all() and (cut.points <= HIGH + 1e-9).all()
    assert cut.nearest(cut.points, cut.normals).tolist() == list(range(len(cut.points)))


def test_patches_of_a_notched_face_lie_within_it():
    corners = np.array([[0, 0, 0], [4, 0, 0], [4, 0, 4], [3, 0, 4], [3, 0, 1], [0, 0, 1.0]])
    cut = patches([corners], 60)
    x, z = cut.points[:, 0], cut.points[:, 2]
    assert ((z < 1) | (x > 3)).all() and len(cut.points) > 30


def test_thousands_of_small_faces_share_patches():
    corner = np.array([[0, 0, 0], [0.01, 0, 0], [0, 0, 0.01]])
    faces = [corner + [0.01 * i, 0, 0.01 * j] for i in range(60) for j in range(60)]
    assert len(patches(faces, 100).points) <= 200
    assert len(patches([np.zeros((3, 3)), corner], 4).points) >= 1, "a face without area is left out"


def test_means_between_patches_are_means():
    cut = patches(box(LOW, HIGH), 300)
    index, weight = cut.between(cut.points + 0.1, cut.normals)
    assert weight.sum(-1) == pytest.approx(1) and (weight >= 0).all() and index.shape == weight.shape


def test_lattice_holds_only_places_that_were_given():
    places = np.random.default_rng(2).uniform(LOW, HIGH, (4000, 3))
    places = places[places[:, 0] < 0]
    found = lattice(places, LOW, HIGH, 200)
    assert (found.points[:, 0] < 0).all() and len(np.unique(found.cells(found.points))) == len(found.points)
    nearest = found.nearest()
    assert nearest(found.points).tolist() == list(range(len(found.points)))
    far = nearest(np.array([[1.4, 1.0, -1.0], [90.0, 1.0, -1.0]]))
    assert (found.points[far, 0] > -0.5).all(), "a cell without a point takes the nearest"


# ---- what is not shown -------------------------------------------------------------------------------

def test_what_the_photograph_does_not_show_is_lit_by_the_lamp_and_the_room(closed):
    (_, room), light, _ = closed
    found = room.beside.mean(room.beside.radiance)
    true = room.beside.mean(np.where(room.beside.patch[..., None] >= 0, ALBEDO * light[room.beside.patch], 0))
    assert found.mean(0) == pytest.approx(true.mean(0), rel=RAYS)
    behind = room.patches.points[:, 2] > 0.9  # the wall behind the camera
    assert behind.any() and found[behind].mean(0) == pytest.approx(true[behind].mean(0), rel=2 * RAYS)


def test_lamps_throw_nothing_back(closed):
    (_, room), _, _ = closed
    below = np.argmin(np.linalg.norm(room.lattice.points - [0, 2.1, -1.5], axis=1))
    up = room.within.directions[below, :, 1] > 0.9
    assert (room.within.radiance[below, up] == 0).all(-1).any()


def test_fewer_directions_stand_for_the_whole_sphere(closed):
    (view, _), _, _ = closed
    few = view.fewer(len(view.directions) // 2)
    assert len(few.directions) == len(view.directions) // 2 == few.face.shape[-1] == few.radiance.shape[-2]
    assert few.solid_angles.sum() == pytest.approx(view.solid_angles.sum(), rel=1e-12)
    # they lie as evenly: their mean direction is that of the sphere
    assert np.abs(few.solid_angles @ few.directions).max() < 0.05 * few.solid_angles.sum()
    assert len(view.fewer(10000).directions) == len(view.directions)


# ---- light that is not lost --------------------------------------------------------------------------

@pytest.mark.parametrize("asymmetry", [0.0, 0.6])
@pytest.mark.parametrize("scattering", [0.05, 0.3, 1.0])
def test_between_black_walls_all_that_is_scattered_arrives(closed, scattering, asymmetry):
    (_, room), _, lamps = closed
    medium = fog(scattering, asymmetry=asymmetry)
    dark = replace(room, within=replace(room.within, radiance=0 * room.within.radiance),
                   beside=replace(room.beside, radiance=0 * room.beside.radiance))
    found = transport(dark, medium, lamps)
    clear, foggy = room.lit_by(lamps, {"lamp": STRENGTH})[0].on(
        room.patches.points, room.patches.normals, np.arange(len(room.patches.points)), medium)
    # cells are as long as the way on which fog this dense dims a lamp
    assert found.E.mean(0) == pytest.approx((clear - foggy).mean(0), rel=0.08)


@pytest.mark.parametrize("scattering", [0.05, 0.3, 1.0])
def test_surfaces_take_in_fog_what_they_take_without(closed, scattering):
    """What a lamp sends ends on the surfaces, whatever turned it before."""
    (_, room), light, lamps = closed
    found = transport(room, fog(scattering), lamps)
    foggy = room.lit_by(lamps, {"lamp": STRENGTH})[0].on(
        room.patches.points, room.patches.normals, np.arange(len(room.patches.points)), fog(scattering))[1]
    taken = ((1 - ALBEDO) * (foggy + found.E)).mean(0)
    assert taken == pytest.approx(((1 - ALBEDO) * light).mean(0), rel=0.06)


def test_without_fog_nothing_changes(closed):
    (view, room), _, lamps = closed
    found = transport(room, fog(1e-9), lamps)
    assert found.E == pytest.approx(found.clear, rel=1e-5, abs=1e-8)
    seen_there = of_view(CAMERA, view, areas_and_normals(box(LOW, HIGH))[1], room.patches)
    assert found.arriving(seen_there) == pytest.approx(seen_there.radiance, rel=1e-4, abs=1e-6)


@pytest.mark.parametrize("scattering, absorption", [(1e-12, 0), (0, 5.0), (30, 0), (3e3, 1e3), (1e4, 0)])
def test_at_the_extremes(closed, scattering, absorption):
    (view, room), _, lamps = closed
    found = transport(room, fog(scattering, absorption, 0.9), lamps)
    arriving = found.arriving(of_view(CAMERA, view, areas_and_normals(box(LOW, HIGH))[1], room.patches))
    for values in (found.J, found.E, arriving):
        assert np.isfinite(values).all() and values.min() >= 0
    if absorption and not scattering:
        assert found.E.mean() < 0.05 * found.clear.mean(), "fog that only absorbs leaves next to nothing"


def test_fog_thickens_to_the_same_by_any_medium(closed):
    """A height fog of endless scale is the even fog; the cells' own sums stand for its closed form."""
    (_, room), _, lamps = closed
    even = transport(room, fog(0.4), lamps)
    high = registry("media")["height"].model_validate({
        "type": "height", "absorption_coefficient": [0] * 3, "scattering_coefficient": [0.4] * 3, "scale_height": 1e6,
        "phase_function": {"type": "henyey_greenstein", "asymmetry": 0.0}})
    found = transport(room, high, lamps)
    assert found.J == pytest.approx(even.J, rel=1e-3) and found.E == pytest.approx(even.E, rel=1e-3)


@pytest.mark.parametrize("name", ["near", "far"])
def test_what_reaches_points_from_a_lamp_is_the_angle_it_fills(name):
    """By many small parts of it."""
    light, rng = lamp(), np.random.default_rng(3)
    low, high = {"near": ([-0.6, 1.7, -2.1], [0.6, 2.3, -0.9]), "far": (LOW, [1.5, 1.5, 1.0])}[name]
    points = rng.uniform(low, high, (400, 3))
    centres, areas, normal = light.parts(60)
    way = points[:, None] - centres
    squared = (way**2).sum(-1)
    true = (areas * np.maximum(way @ normal, 0) / squared**1.5).sum(1)
    found = light.reaching(points)
    assert found.irradiance == pytest.approx(true, rel=0.06)
    assert found.irradiance.mean() == pytest.approx(true.mean(), rel=0.02)


def test_many_bulbs_reach_as_each_does():
    lamps = registry("lights")["lamps"].model_validate(
        {"type": "lamps", "positions": [{"point": [-1, 2, -2]}, {"point": [1, 2, -2]}], "intensity": [1, 1, 1]})
    found = lamps.reaching(np.array([[0.0, 1.0, -2.0], [-1.0, 1.0, -2.0]]))
    assert found.irradiance[0] == pytest.approx(2 / (2 + 0.01)) and found.travels[0] == pytest.approx([0, -1, 0])
    assert np.linalg.norm(found.travels, axis=-1) == pytest.approx(1) and found.path[0] == pytest.approx(np.sqrt(2))


def test_a_floor_without_walls():
    """What it throws back is all there is; the fog above it is lit, and finite."""
    floor = [np.array([[-2, 0, 1], [2, 0, 1], [2, 0, -4], [-2, 0, -4.0]])]
    view, room = seen(floor, {"lamp": lamp()}, lambda points, face: np.where((face >= 0)[..., None], 0.3, 0.0) * np.ones(3))
    found = transport(room, fog(0.3), {"lamp": lamp()})
    assert len(room.lattice.points) > 20 and np.isfinite(found.J).all() and found.J.min() >= 0 < found.J.mean()
    arriving = found.arriving(of_view(CAMERA, view, areas_and_normals(floor)[1], room.patches))
    assert np.isfinite(arriving).all() and arriving.min() >= 0
