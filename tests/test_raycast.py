"""Depth and face maps against closed forms, at edges, and in degenerate positions."""

import time

import numpy as np
import pytest
import shapely

from pipeline.geometry.boxes import AxisBox
from pipeline.geometry.camera import Camera, from_field_of_view, rotation
from pipeline.geometry.raycast import first_hits

SQUARE = np.array([[-1, -1, -2], [1, -1, -2], [1, 1, -2], [-1, 1, -2.0]])


def towards(points):
    """(1, N, 3) unit vectors from the origin to points (N, 3)."""
    points = np.asarray(points, float)
    return (points / np.linalg.norm(points, axis=1, keepdims=True))[None]


def test_depth_is_radial_and_the_nearer_face_wins():
    far = SQUARE * 2
    depth, index = first_hits(
        np.zeros(3), towards([[0, 0, -1], [0.4, 0, -1], [0.9, 0, -1], [0, 0, 1]]), [far, SQUARE]
    )
    # the far square is the near one seen from the same place, so the near one hides it exactly
    np.testing.assert_allclose(depth[0, :2], [2, 2 * np.hypot(1, 0.4)], rtol=1e-14)  # double rounding
    assert index[0].tolist() == [1, 1, -1, -1] and np.isinf(depth[0, 2:]).all()
    assert index.dtype == np.int32


@pytest.mark.parametrize("seed", range(6))
def test_no_ray_leaks_between_the_walls_of_a_room(seed):
    """Rays aimed at points on the 12 edges and 8 corners, exactly and within a few ulp.

    Nor does one meet two walls, of which it would report whichever is listed first (but at a corner,
    within rounding, it may meet all three).
    """
    rng = np.random.default_rng(seed)
    box = AxisBox(
        rng.uniform(-5, -1, 3), rng.uniform(1, 5, 3), yaw=rng.uniform(-180, 180) if seed % 2 else 0.0
    )
    corners = np.array(list(box.corners().values()))
    origin = corners.T @ rng.dirichlet(np.ones(8))
    local = corners @ box.world_from_box
    pairs = [
        (corners[i], corners[j])
        for i in range(8)
        for j in range(i)
        if (np.abs(local[i] - local[j]) < 1e-9).any()
    ]  # edges and diagonals of faces
    along = np.concatenate([np.linspace(a, b, 101) for a, b in pairs])
    rays = along - origin
    rays = np.concatenate(
        [rays] + [rays * (1 + rng.integers(-3, 4, rays.shape) * 2.0**-52) for _ in range(10)]
    )
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    faces = list(box.faces().values())
    depth, index = first_hits(origin, rays[None], faces)
    assert (index >= 0).all() and np.isfinite(depth).all()
    ambiguous = index != 5 - first_hits(origin, rays[None], faces[::-1])[1]
    at_corner = np.tile(np.isin(np.arange(101), [0, 100]), len(rays) // 101)
    assert not ambiguous[0, ~at_corner].any()
    np.testing.assert_allclose(
        depth[0, : len(along)], np.linalg.norm(along - origin, axis=1), rtol=1e-9
    )  # half an ulp at a grazing edge


def test_non_convex_face_agrees_with_shapely():
    outline = np.array([[0, 0], [4, 0], [4, 3], [3, 3], [3, 1], [2, 2.5], [1, 1], [1, 3], [0, 3.0]])
    turn = rotation(20, -35, 15)
    face = np.c_[outline - 2, np.full(len(outline), 3.0)] @ turn.T
    grid = np.stack(np.meshgrid(np.linspace(-0.53, 4.51, 97), np.linspace(-0.52, 3.57, 89)), -1)
    points = np.concatenate([grid - 2, np.full(grid.shape[:2] + (1,), 3.0)], -1) @ turn.T
    rays = points / np.linalg.norm(points, axis=-1, keepdims=True)
    depth, index = first_hits(np.zeros(3), rays, [face])
    expected = shapely.contains_xy(shapely.Polygon(outline), grid[..., 0], grid[..., 1])
    assert np.array_equal(index >= 0, expected) and expected.any() and not expected.all()
    # rounding of a plane through rotated corners
    np.testing.assert_allclose(depth[expected], np.linalg.norm(points[expected], axis=-1), rtol=1e-12)


def test_every_direction_of_the_sphere_meets_a_room():
    theta, phi = np.meshgrid(np.linspace(0, np.pi, 181), np.linspace(0, 2 * np.pi, 361))
    rays = np.stack([np.sin(theta) * np.cos(phi), np.cos(theta), np.sin(theta) * np.sin(phi)], -1)
    box = AxisBox(np.array([-2.0, 0, -4]), np.array([2.0, 2.5, 1]))
    depth, index = first_hits(np.array([0, 1.5, 0]), rays, list(box.faces().values()))
    assert (index >= 0).all()
    assert depth.min() == pytest.approx(1.0, rel=1e-12)  # the nearest surface straight up or in front
    points = np.array([0, 1.5, 0]) + rays * depth[..., None]
    off = np.minimum(np.abs(points - box.lower), np.abs(points - box.upper)).min(-1)
    assert off.max() < 1e-12  # metres; rounding


@pytest.mark.parametrize("origin", [[0, 0, -2], [1, 1, -2], [0.5, 1, -2], [5, 0, -2]])
def test_origin_on_the_plane_edge_or_corner_of_a_face_stays_finite(origin):
    rays = from_field_of_view(16, 16, 90)
    behind = SQUARE + [0, 0, -3]
    depth, index = first_hits(
        np.array(origin, float), rays.directions(rays.pixel_centres()), [SQUARE, behind]
    )
    assert not np.isnan(depth).any() and (depth > 0).all()
    assert set(np.unique(index)) <= {-1, 1}


def test_collapsed_faces_and_no_faces_are_missed():
    rays = towards([[0, 0, -1], [0.1, 0.1, -1]])
    line = np.array([[0, 0, -2], [1, 1, -2], [2, 2, -2.0]])
    for faces in ([], [line], [np.repeat(line[:1], 4, 0)]):
        depth, index = first_hits(np.zeros(3), rays, faces)
        assert np.isinf(depth).all() and (index == -1).all()


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_unit_of_length_does_not_matter(scale):
    camera = from_field_of_view(40, 30, 80, yaw=10, pitch=-20)
    box = AxisBox(np.array([-1.5, 0.0, -5]), np.array([2.0, 2.5, 1.5]))
    faces = list(box.faces().values())
    depth, index = first_hits(camera.position, camera.directions(camera.pixel_centres()), faces)
    scaled, same = first_hits(
        camera.position * scale, camera.directions(camera.pixel_centres()), [face * scale for face in faces]
    )
    assert np.array_equal(index, same)
    np.testing.assert_allclose(scaled, depth * scale, rtol=1e-12)  # rounding


def test_blocks_do_not_show(monkeypatch):
    camera = from_field_of_view(37, 23, 80, yaw=10, pitch=-20)
    faces = list(AxisBox(np.array([-1.5, 0.0, -5]), np.array([2.0, 2.5, 1.5])).faces().values())
    whole = first_hits(camera.position, camera.directions(camera.pixel_centres()), faces)
    monkeypatch.setattr("pipeline.geometry.raycast._BLOCK_VALUES", 1)
    depth, index = first_hits(camera.position, camera.directions(camera.pixel_centres()), faces)
    assert np.array_equal(index, whole[1])
    np.testing.assert_allclose(depth, whole[0], rtol=1e-14)  # BLAS may sum in another order


def test_forty_quads_at_480_by_480_take_about_a_second():
    rng = np.random.default_rng(0)
    camera = from_field_of_view(480, 480, 70)
    faces = []
    for _ in range(7):
        lower = rng.uniform([-3, 0, -8], [2, 1.5, -3])
        faces += list(AxisBox(lower, lower + rng.uniform(0.2, 1, 3)).faces().values())
    start = time.process_time()
    depth, _ = first_hits(camera.position, camera.directions(camera.pixel_centres()), faces[:40])
    assert np.isfinite(depth).any()
    # 0.35 s of processor time when measured alone; an order of magnitude would mean a lost vectorisation
    assert time.process_time() - start < 3


def test_one_pixel_and_one_column():
    for shape in ((1, 1), (1, 9), (9, 1)):
        camera = Camera(
            shape[1], shape[0], 5.0, np.array(shape[::-1]) / 2, np.diag([1.0, -1, -1]), np.zeros(3)
        )
        depth, index = first_hits(camera.position, camera.directions(camera.pixel_centres()), [SQUARE])
        assert depth.shape == shape and index[shape[0] // 2, shape[1] // 2] == 0
