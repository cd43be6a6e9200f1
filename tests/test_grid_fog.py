"""Fog from a file: where its values stand, what POV-Ray makes of them, and what is refused."""

import io
import json
from pathlib import Path

import numpy as np
import pytest
import tinyvdb
from pydantic import ValidationError

from pipeline.cli import main
from pipeline.errors import InputError
from pipeline.imaging.maps import read_map
from pipeline.physics.density_grid import DensityGrid, density_file, read_density_file
from pipeline.physics.vdb_grid import read_vdb
from pipeline.plugins.media.grid import Grid
from tests.test_light_transport import DESCRIBED, chain, run
from tests.test_noise_fog import even_path, plane_of_points, povray_density, relative_errors, within_bounds

BOX = {"lower": [-1.0, 0.0, -2.0], "upper": [2.0, 1.5, 1.0]}
#: Written by OpenVDB itself, see reference/make_vdb.py.
VDB, TILES = ((Path(__file__).parent / "reference" / name).read_bytes() for name in ("density.vdb", "tiles.vdb"))


def npy(values) -> bytes:
    file = io.BytesIO()
    np.save(file, values)
    return file.getvalue()


def grid_of(values, **settings) -> Grid:
    settings = {"visibility": 9.0, "file": "fog.npy", **({} if "centre" in settings else BOX), **settings}
    return Grid(**settings).loaded(lambda name: npy(values))


def blob(shape=(14, 10, 12)):
    """A cloud that fades towards the faces of its box."""
    x, y, z = np.meshgrid(*(np.linspace(-1, 1, n) for n in shape), indexing="ij")
    return np.exp(-3 * (x**2 + y**2 + z**2)) * (1.2 + np.sin(5 * x) * np.cos(4 * z))


def test_values_stand_at_the_centres_of_cells():
    values = np.random.default_rng(0).uniform(0, 4, (6, 3, 5))
    medium = grid_of(values, normalise="none")
    spacing = np.array([0.5, 0.5, 0.6])
    index = np.stack(np.meshgrid(*map(np.arange, values.shape), indexing="ij"), -1)
    centres = BOX["lower"] + (index + 0.5) * spacing
    # 16 bits of a largest value of 4
    np.testing.assert_allclose(medium.density(centres), values, atol=4e-5)
    between = (centres[2, 1, 3] + centres[3, 1, 3]) / 2
    assert medium.density(between) == pytest.approx(values[2:4, 1, 3].mean(), abs=1e-4)
    # on a face half of it is left, one cell further nothing
    assert medium.density(centres[0, 1, 2] - [0.25, 0, 0]) == pytest.approx(values[0, 1, 2] / 2, abs=1e-4)
    assert medium.density(centres[5, 1, 2] + [0.5, 0, 0]) == 0
    assert medium.density(np.array([40.0, 1.0, 0.0])) == 0


def test_the_amount_of_fog_is_kept():
    medium = grid_of(blob(), normalise="none")
    step = 0.05
    x, y, z = (np.arange(a - 0.4, b + 0.4, step) + step / 2 for a, b in zip(BOX["lower"], BOX["upper"]))
    points = np.stack(np.meshgrid(x, y, z, indexing="ij"), -1)
    # a midpoint sum over kinks of trilinear cells a quarter as fine
    assert medium.density(points).mean() * points[..., 0].size * step**3 == pytest.approx(
        blob().mean() * 3 * 1.5 * 3, rel=5e-3)


@pytest.mark.parametrize("normalise, expected", [("mean", 1 / 1.5), ("max", 0.5), ("none", 1.0)])
def test_normalisation(normalise, expected):
    values = np.ones((4, 4, 4))
    values[:2] = 2
    point = np.array([1.5, 0.7, -0.5])
    assert grid_of(values, normalise=normalise).density(point) == pytest.approx(expected, abs=1e-4)
    twice = grid_of(values, normalise=normalise, density_scale=2.0)
    assert twice.density(point) == pytest.approx(2 * expected, abs=2e-4)


@pytest.mark.parametrize("axes", ["xyz", "zyx", "xzy"])
def test_axes(axes):
    values = np.random.default_rng(0).uniform(size=(4, 5, 6))
    as_stored = np.einsum(f"xyz->{axes}", values)
    point = np.array([0.3, 0.8, 0.2])
    expected = float(grid_of(values).density(point))
    assert grid_of(as_stored, axes=axes).density(point) == pytest.approx(expected, abs=1e-4)


def test_turn_about_the_centre():
    values, centre = blob(), np.array([0.5, 0.75, -0.5])
    straight = grid_of(values, centre=centre.tolist(), size=[3.0, 1.5, 3.0])
    turned = grid_of(values, centre=centre.tolist(), size=[3.0, 1.5, 3.0], yaw=90.0)
    point = np.array([1.1, 0.6, -0.1])
    assert straight.density(point) == pytest.approx(float(grid_of(values).density(point)), abs=1e-5)
    # a quarter turn takes z to x and x to -z, as of cuboids
    x, y, z = point - centre
    assert turned.density(centre + [z, y, -x]) == pytest.approx(float(straight.density(point)), abs=1e-5)


def test_both_file_formats_say_the_same():
    values = np.rint(np.random.default_rng(0).uniform(size=(3, 4, 5)) * 65535)
    values[0, 0, 0] = 65535
    settings = {"visibility": 9.0, "file": "fog.df3", **BOX}
    header = np.array(values.shape, ">u2").tobytes()
    for bits in (8, 16, 32):
        stored = np.rint(values / 65535 * (2**bits - 1)).astype(f">u{bits // 8}")
        data = header + stored.transpose(2, 1, 0).tobytes()
        one = Grid(**settings, normalise="max").loaded(lambda name: data)
        point = np.array([0.4, 0.3, 0.2])
        assert one.density(point) == pytest.approx(
            float(grid_of(values, normalise="max").density(point)), abs=2 ** -min(bits, 14))
    cube = DensityGrid(values / 65535, np.zeros(3), np.ones(3), (True, True, True))
    np.testing.assert_allclose(read_density_file(density_file(cube)), cube.encoded() / 65535)


@pytest.mark.parametrize("outside", [0.0, 0.3, 5.0])
@pytest.mark.parametrize("lower, upper", [([-2, -1, 0.1], [3, 3, 0.1]), ([-2, 0.6, -3], [3, 0.6, 2])])
def test_povray_reads_the_same_density(tmp_path, outside, lower, upper):
    """In the box, in its margin and beyond, whichever is denser. Half floats of the render: 2^-11."""
    medium = grid_of(np.random.default_rng(0).uniform(0.1, 1, (5, 4, 6)), outside=outside, yaw=25.0)
    points = plane_of_points(lower, upper)
    expected = medium.density(points)
    assert expected.max() > 1 and (np.abs(expected - outside) < 1e-4).any()
    np.testing.assert_allclose(povray_density(tmp_path, medium, points), expected, rtol=1e-3, atol=1e-3)


def test_paths_are_integrals_of_the_density():
    random = np.random.default_rng(4)
    for outside in (0.0, 0.5):
        medium = grid_of(random.uniform(size=(5, 4, 6)), outside=outside, yaw=-40.0)
        starts, ends = random.uniform(-6, 6, (2, 60, 3))
        dense = even_path(medium, starts, ends, 4000)
        # two midpoints a cell; these values have no smoothness at all
        np.testing.assert_allclose(medium.density_path(starts, ends), dense, atol=0.02)
    outside_only = grid_of(blob(), outside=0.5)
    assert outside_only.density_path(np.array([0.0, 9.0, 0.0]), np.array([8.0, 9.0, 0.0])) == pytest.approx(4)
    down = np.array([[0.0, -1.0, 0.0]])
    along = outside_only.density_along(np.array([0.5, 5.0, -0.5]), down, np.array([[1.0, 2.0, 9.0]]))
    assert along[0, :2] == pytest.approx([0.5, 1.0]) and along[0, 2] > 2.5
    assert outside_only.top() is None and not outside_only.daylight_path(np.zeros((1, 3)), down).any()
    assert grid_of(blob()).top() == pytest.approx(1.5 + 0.075)


@pytest.mark.parametrize("kind, count, steps", [
    ("point", 120, {}), pytest.param("area", 80, {"steps": 120}, marks=pytest.mark.slow)])
def test_lamps_against_dense_integration(tmp_path, kind, count, steps):
    light = {**DESCRIBED[kind], "sub_lights": 5} if kind == "area" else DESCRIBED[kind]
    fog = {"type": "grid", "visibility": 10.0, "file": "cloud.npy", "lower": [-1.2, 0.2, -2.8],
           "upper": [1.3, 2.2, 1.5], "yaw": 12.0, "outside": 0.1, "phase_function": {"type": "isotropic"}}
    build = chain(tmp_path, {kind: light}, fog={"type": "homogeneous", "absorption_coefficient": [0, 0, 0],
                                                  "scattering_coefficient": [0, 0, 0]}, render={"quality": "normal"})
    scene = json.loads(build.scene_file.read_text())
    build.scene_file.write_text(json.dumps({**scene, "fog": fog}))
    (build.source / "cloud.npy").write_bytes(npy(blob()))
    run(build)
    medium = Grid(**fog).loaded(lambda name: npy(blob()))
    errors = relative_errors(build, medium, kind, count, **steps)
    assert within_bounds(errors), errors


@pytest.mark.parametrize("data, said", [
    (b"no array", "cannot be read"),
    (npy(np.ones((4, 4))), "holds 4x4 values"),
    (npy(np.ones((2, 2, 2), complex)), "complex"),
    (npy(np.full((2, 2, 2), np.nan)), "not finite"),
    (npy(-np.ones((2, 2, 2))), "negative"),
    (npy(np.zeros((2, 2, 2))), "no density to normalise"),
    (npy(np.array([[[{}]]], object)), "cannot be read"),
    (npy(np.ones((2, 2, 2)))[:-9], "cannot be read"),
])
def test_files_that_are_refused(data, said):
    with pytest.raises(InputError, match=said):
        Grid(visibility=9.0, file="fog.npy", **BOX).loaded(lambda name: data)


def test_a_header_that_promises_too_much_is_refused_before_it_is_believed():
    header = npy(np.ones((2, 2, 2))).replace(b"(2, 2, 2), }", b"(90000, 90000, 9), }")
    with pytest.raises(InputError, match="cannot be read|holds 90000x"):
        Grid(visibility=9.0, file="fog.npy", **BOX).loaded(lambda name: header)


def ramp() -> np.ndarray:
    """Grid `density` of density.vdb, as make_vdb.py wrote it: every fourth voxel is inactive, the background 0.05."""
    i, j, k = np.indices((6, 5, 4))
    return np.where((i + j + k) % 4, 0.1 * i + 0.02 * j + 0.004 * k, 0.05).astype(np.float32)


def of_vdb(data: bytes, **settings) -> Grid:
    return Grid(visibility=9.0, file="fog.vdb", **BOX, **settings).loaded(lambda name: data)


def far_apart() -> bytes:
    """Two more voxels, at the ends of the range of indices."""
    file = tinyvdb.from_bytes(VDB)
    file.read_grids()
    places = np.array([[10**9, 0, 0], [-10**9, 0, 0]], np.int32)
    file.extend_grid_from_sparse(1, places.tobytes(), np.ones(2, np.float32).tobytes(), "density")
    return file.to_bytes()


@pytest.mark.parametrize("axes", ["xyz", "zyx"])
def test_openvdb_says_the_same_as_numpy(axes):
    np.testing.assert_array_equal(read_vdb(VDB, 120), ramp())
    one, other = of_vdb(VDB, axes=axes).grid(), grid_of(ramp(), axes=axes).grid()
    np.testing.assert_array_equal(one.values, other.values)
    np.testing.assert_array_equal(one.first, other.first)


@pytest.mark.parametrize("data, said", [
    (b"no grid", "no OpenVDB file, or a damaged one"),
    (VDB[:len(VDB) // 2], "no OpenVDB file, or a damaged one"),
    (VDB[:-1], "no OpenVDB file, or a damaged one"),
    (VDB.replace(b"Tree_float", b"Tree_int32"), "grid 'density' is of type 'Tree_int32_5_4_3'"),
    (VDB.replace(b"Tree_float", b"Tree_int32").replace(b"density", b"daytime"), "has no grid of floats"),
    (TILES, "active tiles"),
    (TILES.replace(b"file_voxel_count", b"file_voxel_other"), "active tiles"),
    (far_apart(), "span 2000000001 x "),
])
def test_openvdb_files_that_are_refused(data, said):
    with pytest.raises(InputError, match=said) as caught:
        of_vdb(data)
    assert "\n" not in str(caught.value)


def test_openvdb_is_measured_before_it_is_made_dense():
    with pytest.raises(ValueError, match="span 6 x 5 x 4, more than 119 values"):
        read_vdb(VDB, 119)
    with pytest.raises(ValueError, match="more than 89 voxels are active"):
        read_vdb(VDB, 89)


@pytest.mark.parametrize("seed", range(40))
def test_damaged_openvdb_is_read_or_refused(seed):
    random, data = np.random.default_rng(seed), np.frombuffer(VDB, np.uint8).copy()
    # behind the number of grids: the library reserves memory for as many as it says
    data[random.integers(100, len(data), 20)] = random.integers(0, 256, 20)
    try:
        of_vdb(data.tobytes())
    except InputError as error:
        assert "\n" not in str(error) and str(error).startswith("fog.vdb: ")


@pytest.mark.parametrize("settings, said", [
    ({"file": "fog.txt", **BOX}, "name a .npy, .df3 or .vdb file"),
    ({"file": "fog.npy"}, "stated in no way"),
    ({"file": "fog.npy", **BOX, "centre": [0.0, 0.0, 0.0]}, "or in two"),
    ({"file": "fog.npy", "lower": [0.0, 0.0, 0.0], "upper": [1.0, -1.0, 1.0]}, "not above lower"),
])
def test_mistakes(settings, said):
    with pytest.raises(ValidationError, match=said):
        Grid(visibility=9.0, **settings)


def test_a_missing_file_is_one_line(tmp_path, capsys):
    build = chain(tmp_path, {"point": DESCRIBED["point"]})
    scene = json.loads(build.scene_file.read_text())
    fog = {"type": "grid", "visibility": 10.0, "file": "nowhere.npy", **BOX}
    build.scene_file.write_text(json.dumps({**scene, "fog": fog}))
    capsys.readouterr()
    code = [main([stage, "--scene", build.scene, "--scenes", str(build.scenes), "--build", str(build.builds)])
            for stage in ("resolve", "plan")]
    assert 2 in code and "nowhere.npy" in capsys.readouterr().err
