"""Solids that stand in for a photograph's depth: rays from the camera meet them where the depth says."""

import cv2
import numpy as np
import pytest

from pipeline.geometry.camera import from_field_of_view
from pipeline.geometry.meshes import mesh_hits
from pipeline.geometry.raycast import first_hits
from pipeline.geometry.regions import Region, cut, depth_of_regions, polygon_mask
from pipeline.geometry.stand_in import THICKNESS_SHARE, Solid, regions_of, stand_in
from pipeline.plugins.base import World
from pipeline.plugins.registry import registry

SKY = 5000.0
VIEW = from_field_of_view(160, 120, 60, camera_height=1.6, pitch=-3, roll=2)
LEFT_OF_HORIZON, RIGHT_OF_HORIZON = [0, 51], [160, 45.5]  # the ground begins a little below it


def drawn(name, kind, pixels, **described) -> Region:
    return Region(name, kind, *cut(polygon_mask((120, 160), np.array(pixels, float))), **described)


def placed(*regions, view=VIEW, known=None, tolerance=0.01):
    base = (drawn("sky", "sky", [[0, 0], [160, 0], [160, 120], [0, 120]]),
            drawn("ground", "support", [LEFT_OF_HORIZON, [80, 48.5], RIGHT_OF_HORIZON, [160, 120], [0, 120]]))
    found = depth_of_regions(view, [*(base if known is None else ()), *regions], SKY, known)
    return found, stand_in(view, found, SKY, tolerance)


def hits(solid: Solid, view=VIEW) -> np.ndarray:
    return mesh_hits(view.position, view.directions(view.pixel_centres()), solid.vertices, solid.triangles)


def ragged() -> np.ndarray:
    angles = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    return np.c_[80 + (25 + 4 * np.sin(9 * angles)) * np.cos(angles),
                 60 + (30 + 3 * np.sin(14 * angles)) * np.sin(angles)]


def rectangle(left, top, right, bottom) -> np.ndarray:
    return np.array([[left, top], [right, top], [right, bottom], [left, bottom]], float)


# ---- slabs ---------------------------------------------------------------------------------------------------------

BEND = np.array([[90 + 30 * np.cos(a), 60 + 30 * np.sin(a)] for a in np.linspace(1.8, 4.5, 40)])
THINGS = {
    "box": drawn("thing", "vertical", [[40, 20], [90, 20], [90, 90], [40, 90]]),
    "by depth": drawn("thing", "vertical", [[40, 20], [90, 20], [90, 40], [40, 40]], depth=70.0),
    "ragged": drawn("thing", "vertical", ragged()),
    "slanted wall": drawn("thing", "vertical", [[20, 5], [120, 30], [120, 72], [20, 100]],
                          foot=np.array([[20, 100], [120, 72.0]])),
    "outer corner": drawn("thing", "vertical", [[20, 5], [120, 5], [120, 80], [60, 100], [20, 76]],
                          foot=np.array([[20, 76], [60, 100], [120, 80.0]])),
    "inner corner": drawn("thing", "vertical", [[20, 5], [140, 5], [140, 108], [70, 70], [20, 102]],
                          foot=np.array([[140, 108], [70, 70], [20, 102.0]])),
    "arch": Region("thing", "vertical", *cut(polygon_mask((120, 160), rectangle(30, 10, 130, 90),
                                                         [rectangle(60, 40, 100, 80)]))),
    "two parts": Region("thing", "vertical", *cut(polygon_mask((120, 160), rectangle(30, 50, 50, 90))
                                                  | polygon_mask((120, 160), rectangle(90, 60, 99, 90)))),
    "post of two pixels": drawn("thing", "vertical", [[70, 20], [72, 20], [72, 95], [70, 95]]),
    "wire of one": drawn("thing", "vertical", [[70, 20], [71, 20], [72, 95], [71, 95]]),
    "branch": drawn("thing", "vertical", np.concatenate([BEND, BEND[::-1] + [1.5, 0]])),
    "a pixel": drawn("thing", "vertical", [[70, 80], [71, 80], [71, 81], [70, 81]]),
}


@pytest.mark.parametrize("name", THINGS)
def test_slabs_cover_their_outline_at_its_depth(name):
    found, solids = placed(THINGS[name])
    seen = found.labels == 2
    distance = hits(solids["thing"])
    met = np.isfinite(distance)
    # outlines are simplified by a pixel and a half: nothing is missing, or too much, farther than that from them
    inner = cv2.distanceTransform(np.pad(seen, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1] > 2.2
    outer = cv2.distanceTransform((~seen).astype(np.uint8), cv2.DIST_L2, 5) > 2.2
    assert met[inner].all()
    if name != "arch":  # through which its inner sides show
        assert not (met & (distance < found.depth) & outer).any()
    assert (met & seen).sum() >= 0.75 * seen.sum(), "what is thin keeps most of itself"
    both = met & seen
    assert np.median(np.abs(distance / found.depth - 1)[both]) < 1e-5  # corners are rounded to a thousandth of a pixel
    # in a pixel that a fold crosses the piece may be the other one; beside a simplified edge its side shows
    off = np.abs(distance / found.depth - 1)[both]
    assert np.quantile(off, 0.9) < 1e-3 and np.quantile(off, 0.97) < 0.03
    assert len(solids["thing"].triangles) <= (600 if name == "ragged" else 130)


def test_outlines_are_as_coarse_as_shadows_allow():
    found, solids = placed(THINGS["ragged"])
    assert len(solids["thing"].triangles) < 0.5 * 4 * 200  # of an outline with 200 corners: front, back and two sides
    assert len(placed(THINGS["box"])[1]["thing"].triangles) == 12


@pytest.mark.parametrize("thickness", [0.0, 0.5, 20.0])
def test_thickness_is_behind_what_is_seen(thickness):
    wall = drawn("wall", "vertical", [[60, 30], [100, 30], [100, 90], [60, 90]], thickness=thickness)
    found, solids = placed(wall)
    solid = solids["wall"]
    seen = found.labels == 2
    np.testing.assert_allclose(hits(solid)[31:89, 61:99], found.depth[31:89, 61:99], rtol=1e-6)
    away = (solid.vertices - VIEW.position)[:, [0, 2]] @ (solid.vertices.mean(0) - VIEW.position)[[0, 2]]
    away = away / np.linalg.norm((solid.vertices.mean(0) - VIEW.position)[[0, 2]])
    assert np.ptp(away) == pytest.approx(thickness, rel=0.02, abs=0.02 * found.depth[seen].mean())
    # rays from the eye meet the front first everywhere: what is behind it shows nowhere beside it
    silhouette = np.isfinite(hits(solid))
    assert (silhouette & ~cv2.dilate(seen.astype(np.uint8), np.ones((3, 3))).astype(bool)).sum() == 0


def test_thickness_that_is_not_stated_goes_by_the_width():
    found, solids = placed(THINGS["box"])
    solid = solids["thing"]
    count = len(solid.vertices) // 2
    front, back = solid.vertices[:count], solid.vertices[count:]
    width = np.linalg.norm(np.ptp(front[:, [0, 2]], axis=0))
    np.testing.assert_allclose(np.linalg.norm(back - front, axis=1), THICKNESS_SHARE * width, rtol=1e-9)
    np.testing.assert_allclose((back - front)[:, 1], 0, atol=1e-12)


def test_a_front_is_as_wide_as_its_outline():
    found, solids = placed(THINGS["box"])
    count = len(solids["thing"].vertices) // 2
    pixels = VIEW.project(solids["thing"].vertices[:count])[0]
    np.testing.assert_allclose([pixels.min(0), pixels.max(0)], [[40, 20], [90, 90]], atol=2e-3)  # corners are rounded


def test_slabs_are_closed():
    for name, region in THINGS.items():
        triangles = placed(region)[1]["thing"].triangles
        edges, times = np.unique(np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0,
                                 return_counts=True)
        assert (times % 2 == 0).all(), name  # every edge joins two faces: no light leaks in


# ---- ground --------------------------------------------------------------------------------------------------------

def test_all_level_ground_is_one_polygon_that_reaches_as_far_as_anything():
    lawn = drawn("lawn", "support", [[0, 90], [60, 90], [60, 120], [0, 120]])
    found, solids = placed(lawn, THINGS["box"])
    assert set(solids) == {"ground", "thing"} and len(solids["ground"].triangles) == 2
    assert regions_of(solids, found.regions) == {"ground": "ground", "lawn": "ground", "thing": "thing"}
    support = (found.labels == 1) | (found.labels == 2)
    below = support & (found.depth < 0.99 * SKY)
    np.testing.assert_allclose(hits(solids["ground"])[below], found.depth[below], rtol=1e-9)


def test_ground_with_near_and_far_values_is_a_flat_piece_of_its_own():
    bench = drawn("bench", "support", [[20, 80], [90, 80], [120, 119], [10, 119]], near=2.0, far=4.0)
    found, solids = placed(bench)
    seen = found.labels == 2
    distance = hits(solids["bench"])
    assert np.isfinite(distance[seen]).mean() > 0.95 and len(solids["bench"].triangles) <= 6
    met = seen & np.isfinite(distance)
    np.testing.assert_allclose(distance[met], found.depth[met], rtol=1e-6)
    assert regions_of(solids, found.regions)["bench"] == "bench"


def test_sky_and_hidden_regions_have_none():
    hidden = drawn("hidden", "vertical", [[50, 50], [60, 50], [60, 90]], depth=9.0)
    far = drawn("far", "vertical", [[100, 10], [120, 10], [120, 30], [100, 30]], depth=2 * SKY)
    found, solids = placed(hidden, THINGS["box"], far)
    assert "sky" not in solids and "hidden" not in solids
    assert (found.depth[11:29, 101:119] == SKY).all()


# ---- meshes of depth maps --------------------------------------------------------------------------------------------

def street_map() -> np.ndarray:
    """Depth [m] of ground up to the horizon, a wall, a pole and a ball."""
    rays = VIEW.directions(VIEW.pixel_centres())
    ground = np.where(rays[..., 1] < 0, -1.6 / np.minimum(rays[..., 1], -1e-12), np.inf)
    wall = first_hits(VIEW.position, rays, [np.array([[-6.0, -1, -8], [-6, 9, -8], [-2, 9, -60], [-2, -1, -60]])])[0]
    centre = np.array([2.0, 1.0, -7.0]) - VIEW.position
    along = rays @ centre
    missed = along**2 - (centre @ centre - 0.9**2)
    ball = np.where(missed > 0, along - np.sqrt(np.maximum(missed, 0)), np.inf)
    return np.minimum.reduce([ground, wall, ball, np.full(ground.shape, 2 * SKY)])


def of_map(depth, tolerance=0.01, view=VIEW):
    found, solids = placed(view=view, known=depth, tolerance=tolerance)
    return found, solids["map:1"]


def test_a_plane_needs_few_triangles():
    normal = np.array([0.5, 0.1, 0.8]) / np.linalg.norm([0.5, 0.1, 0.8])
    found, solid = of_map(7 / np.abs(VIEW.directions(VIEW.pixel_centres()) @ normal))
    assert solid.error < 0.01 and len(solid.triangles) <= 4
    distance = hits(solid)
    assert np.isfinite(distance).mean() > 0.97
    assert np.nanquantile(np.abs(np.where(np.isfinite(distance), distance, np.nan) / found.depth - 1), 0.95) < 0.01


@pytest.mark.parametrize("tolerance", [0.003, 0.01, 0.05])
def test_a_mesh_is_as_detailed_as_the_error_allows(tolerance):
    depth = street_map()
    found, solid = of_map(depth, tolerance)
    assert solid.error <= tolerance
    distance = hits(solid)
    seen = (found.depth < 0.99 * SKY)
    off = np.abs(distance / found.depth - 1)[seen]
    # the stated error holds away from tears, where a cell of the grid belongs to nothing
    assert np.quantile(off, 0.9) < 1.5 * tolerance
    assert np.isfinite(distance[found.depth >= SKY]).mean() < 0.02
    # a hundred metres down the street, where rows of the map are farther apart than things, there still is ground
    far = (found.depth > 60) & (found.depth < 200) & (depth == found.depth)
    assert far.any() and np.isfinite(distance[far]).mean() > 0.6


def test_a_crease_is_followed_by_an_edge():
    view = from_field_of_view(65, 65, 60)
    v, u = np.mgrid[:65, :65]
    planar = 100.0 / (10 + np.maximum(u, v))
    forward = view.directions(view.pixel_centres()) @ view.world_from_camera[:, 2]
    _, solid = of_map(planar / forward, view=view)
    assert len(solid.triangles) == 2 and solid.error < 1e-6


def test_a_larger_error_needs_no_more_triangles():
    depth = street_map()
    counts = [len(of_map(depth, tolerance)[1].triangles) for tolerance in (0.003, 0.01, 0.05)]
    assert counts[0] > counts[1] > counts[2]


def test_nothing_spans_what_is_torn():
    depth = np.full((120, 160), 50.0)
    depth[20:100, 60:100] = 4.0
    _, solid = of_map(depth)
    reach = np.linalg.norm(solid.vertices - VIEW.position, axis=1)[solid.triangles]
    assert (reach.max(1) < 1.5 * reach.min(1)).all()
    np.testing.assert_allclose([reach.min(), reach.max()], [4, 50], rtol=1e-6)


def test_a_map_of_noise_says_that_it_is_wrong():
    depth = np.random.default_rng(0).uniform(4, 4.5, (120, 160))
    _, solid = of_map(depth, 1e-4)
    assert solid.error is None or solid.error > 0  # what cannot be reached is stated, not claimed
    np.testing.assert_allclose(np.median(np.linalg.norm(solid.vertices - VIEW.position, axis=1)), 4.25, rtol=0.02)


def test_specks_of_a_map_have_no_mesh():
    known = np.full((120, 160), 2 * SKY)
    known[50, 50] = 5.0
    found, solids = placed(known=known)
    assert solids == {} and found.depth[50, 50] == 5


@pytest.mark.parametrize("size", [(1, 1), (1, 30), (30, 1)])
def test_photographs_of_few_pixels(size):
    view = from_field_of_view(*size, 60, camera_height=1.6, pitch=-30)
    whole = [np.ones(size[::-1], bool), np.s_[0:size[1], 0:size[0]]]
    ground, wall = Region("g", "support", *whole), Region("w", "vertical", *whole, depth=3.0)
    for regions, known in (([ground], None), ([wall], None), ([], np.full(size[::-1], 3.0))):
        found = depth_of_regions(view, regions, SKY, known)
        for solid in stand_in(view, found, SKY).values():
            assert np.isfinite(solid.vertices).all() and solid.triangles.max() < len(solid.vertices)


# ---- rays and meshes -------------------------------------------------------------------------------------------------

def cube(centre, size=1.0):
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * size / 2 + centre
    quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    return corners, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


@pytest.mark.parametrize("count", [1, 40, 3000])
def test_hits_are_those_of_every_ray_with_every_triangle(count):
    rng = np.random.default_rng(count)
    centres = rng.normal(size=(count, 3)) * 4
    vertices = (centres[:, None] + rng.normal(size=(count, 3, 3)) * 0.4).reshape(-1, 3)
    triangles = np.arange(3 * count).reshape(-1, 3)
    rays = rng.normal(size=(40, 50, 3))
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    distance = mesh_hits(np.array([0.1, 0.2, 0.3]), rays, vertices, triangles)
    # each ray with each triangle by the solution of o + t d = a + u e + v f
    expected = np.full(rays.shape[:2], np.inf)
    for a, b, c in vertices.reshape(-1, 3, 3)[:400]:
        system = np.stack([rays, np.broadcast_to(a - b, rays.shape), np.broadcast_to(a - c, rays.shape)], -1)
        t, u, v = np.moveaxis(np.linalg.solve(system, (a - [0.1, 0.2, 0.3])[:, None])[..., 0], -1, 0)
        met = (t > 0) & (u >= 0) & (v >= 0) & (u + v <= 1)
        expected = np.where(met, np.minimum(expected, t), expected)
    if count <= 400:
        np.testing.assert_allclose(distance, expected, rtol=1e-8)
    else:  # a sample of them bounds it
        assert (distance <= expected * (1 + 1e-8)).all() and np.isfinite(distance).mean() > np.isfinite(expected).mean()


def test_no_ray_slips_between_triangles():
    vertices, triangles = cube(np.zeros(3), 2.0)
    rng = np.random.default_rng(0)
    rays = rng.normal(size=(20000, 3))
    # through edges, corners and the diagonals of faces as well
    rays = np.concatenate([rays, np.sign(rays), np.where(np.abs(rays) > 0.5, np.sign(rays), 0) + [0.0, 0.0, 1e-3]])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    distance = mesh_hits(np.zeros(3), rays, vertices, triangles)  # from within
    np.testing.assert_allclose(distance, 1 / np.abs(rays).max(1), rtol=1e-8)


@pytest.mark.parametrize("vertices, triangles", [
    ([[0, 0, -3], [0, 0, -3], [0, 0, -3]], [[0, 1, 2]]),   # a point
    ([[0, 0, -3], [0, 0, -4], [0, 0, -5]], [[0, 1, 2]]),   # a line, along the ray
    ([[0, 0, 0], [1, 0, 0], [0, 0, -5]], [[0, 1, 2]]),     # edge-on, with a corner in the eye
    ([[1, 1, 3], [-1, 1, 3], [0, -1, 3]], [[0, 1, 2]]),    # behind
    ([[0, 0, 0]], np.zeros((0, 3), int)),                  # none
])
def test_triangles_that_no_ray_meets(vertices, triangles):
    rays = VIEW.directions(VIEW.pixel_centres())
    assert not np.isfinite(mesh_hits(np.zeros(3), rays, np.array(vertices, float), np.array(triangles))).any()


def test_a_triangle_round_the_eye_is_met_on_all_sides(monkeypatch):
    monkeypatch.setattr("pipeline.geometry.meshes._PAIRS", 100)  # in bundles
    vertices = np.array([[10, 0.1, 10], [-10, 0.1, 10], [0, 0.1, -20.0]])
    rays = np.random.default_rng(0).normal(size=(5000, 3))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    steep = rays[:, 1] > 0.1  # meets the plane within a metre
    distance = mesh_hits(np.zeros(3), rays, vertices, np.array([[0, 1, 2]]))
    np.testing.assert_allclose(distance[steep], 0.1 / rays[steep, 1], rtol=1e-9)
    assert not np.isfinite(distance[rays[:, 1] < 0]).any()


def test_lengths_from_nanometres_to_light_seconds():
    rays = VIEW.directions(VIEW.pixel_centres())
    vertices, triangles = cube(np.array([0.0, 0, -4]))
    one = mesh_hits(np.zeros(3), rays, vertices, triangles)
    assert np.isfinite(one).sum() > 100
    for scale in (1e-9, 1e8):
        np.testing.assert_allclose(mesh_hits(np.zeros(3), rays, scale * vertices, triangles), scale * one, rtol=1e-9)


# ---- the plugin ----------------------------------------------------------------------------------------------------

def test_the_plugin_is_met_where_it_states_to_be():
    corners, faces = cube(np.array([0.5, 1.2, -4]))
    shape = registry("shapes")["mesh"](type="mesh", vertices=corners.tolist(), triangles=faces.tolist())
    world = World(VIEW)
    assert shape.placed("box", world) is shape and set(world.planes) == {"box.surface"}
    rays = VIEW.directions(VIEW.pixel_centres())
    distance, index = shape.intersect(VIEW.position, rays)
    stated = shape.statement()
    sides = [np.array(stated["vertices"])[list(three)] for three in stated["triangles"]]
    expected = first_hits(VIEW.position, rays, sides)[0]
    assert np.isfinite(expected).sum() > 300
    np.testing.assert_allclose(distance, expected, rtol=1e-9)
    np.testing.assert_array_equal(index, np.where(np.isfinite(expected), 0, -1))


def test_the_plugins_face_is_the_plane_of_a_flat_mesh():
    flat = [[0, 0, -4], [2, 0, -4], [2, 1, -5], [0, 1, -5]]
    shape = registry("shapes")["mesh"](type="mesh", vertices=[[float(x) for x in v] for v in flat],
                                       triangles=[[0, 1, 2], [0, 2, 3]])
    corners = shape.faces()["surface"]
    normal = np.array([0, 1, 1]) / np.sqrt(2)
    np.testing.assert_allclose((corners - flat[0]) @ normal, 0, atol=1e-9)
    np.testing.assert_allclose([corners.min(0), corners.max(0)], [[0, 0, -5], [2, 1, -4]], atol=1e-9)


# ---- what nearer things hide ---------------------------------------------------------------------------------------

def test_a_wall_goes_on_behind_a_post():
    """Light must not come through a hole of the shape of what stands before the wall."""
    wall = drawn("wall", "vertical", rectangle(30, 20, 130, 70), depth=60.0)
    post = drawn("post", "vertical", rectangle(70, 10, 76, 95), depth=12.0)
    _, solids = placed(wall, post)
    assert np.isfinite(hits(solids["wall"])[25:65, 35:125]).all()


def test_a_wall_does_not_go_on_across_the_sky_or_before_what_is_behind_it():
    arch = Region("arch", "vertical", *cut(polygon_mask((120, 160), rectangle(30, 10, 130, 90),
                                                        [rectangle(60, 20, 100, 46)])), depth=60.0, thickness=0.0)
    tower = drawn("tower", "vertical", rectangle(62, 22, 98, 44), depth=300.0)
    for behind in ((), (tower,)):
        _, solids = placed(*behind, arch)
        assert not np.isfinite(hits(solids["arch"])[24:42, 64:96]).any()
