"""The synthetic bathroom: do its photograph, its truth and its annotations agree with one another?"""

from __future__ import annotations

import importlib.util
import json
import shutil
import subprocess
from pathlib import Path

import cv2
import numpy as np
import OpenImageIO as oiio
import pytest
from shapely import Polygon, contains_xy

from pipeline.errors import InputError
from pipeline.geometry.camera import Camera

SCENE = Path(__file__).resolve().parents[1] / "scenes" / "bathroom"


def read_exr(path: Path) -> np.ndarray:
    return np.asarray(oiio.ImageBuf(str(path)).get_pixels(oiio.FLOAT))[..., :3]


def load_render_script():
    spec = importlib.util.spec_from_file_location("bathroom_render", SCENE / "model" / "render.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


render = load_render_script()


@pytest.fixture(scope="module")
def photograph() -> np.ndarray:
    return read_exr(SCENE / "photograph.exr")


@pytest.fixture(scope="module")
def truth() -> dict:
    return json.loads((SCENE / "truth.json").read_text())


@pytest.fixture(scope="module")
def annotations() -> dict:
    return json.loads((SCENE / "annotations.json").read_text())


@pytest.fixture(scope="module")
def camera(truth) -> Camera:
    c = truth["camera"]
    return Camera(c["width_px"], c["height_px"], c["focal_length_px"], np.array(c["principal_point_px"]),
                  np.array(c["world_from_camera"]), np.array(c["position_m"]))


def pixels_well_within(camera: Camera, corners, margin: float) -> np.ndarray:
    """(height, width) mask of pixel centres at least `margin` [pixel] inside a polygon of world corners.

    A negative margin gives the polygon and its surroundings up to that distance.
    """
    outline = Polygon(camera.project(np.array(corners))[0]).buffer(-margin)
    centres = camera.pixel_centres()
    return contains_xy(outline, centres[..., 0], centres[..., 1])


def test_photograph_is_small_finite_and_480_square(photograph):
    assert photograph.shape == (480, 480, 3)
    assert np.isfinite(photograph).all() and photograph.min() > 0  # a closed room: no ray escapes
    assert (SCENE / "photograph.exr").stat().st_size < 2e6


def test_jpeg_is_the_encoded_exr(photograph):
    codes = cv2.imread(str(SCENE / "photograph.jpg"), cv2.IMREAD_COLOR)[..., ::-1].astype(float)
    off = np.abs(codes - 255 * render.srgb_encoded(photograph))
    assert np.median(off) <= 2  # quality 95 without chroma subsampling: a code or two
    assert 0.35 < np.median(codes) / 255 < 0.5  # well exposed


@pytest.mark.parametrize("name", ["ceiling_lamp", "mirror_lamp", "sky"])
def test_emitters_show_their_true_radiance(name, photograph, truth, camera):
    light = truth["lights"][name]
    inside = pixels_well_within(camera, light["corners_m"], 1.0)
    assert inside.sum() > 100
    # Half floats round by 2^-11 at most, once in POV-Ray's file and once in ours.
    np.testing.assert_allclose(photograph[inside], np.broadcast_to(light["radiance_photo_unit"],
                                                                   (inside.sum(), 3)), rtol=2 * 2.0**-11)


def test_emitters_clip_and_most_of_the_picture_does_not(photograph):
    assert 0.02 < (photograph > 1).any(-1).mean() < 0.15


def marked_points(annotations):
    groups = [annotations[key] for key in ("ceiling_lamp", "mirror_lamp", "window", "sun_patch")]
    groups += list(annotations["room_corners"].values()) + annotations["edges"]
    groups += [corner for box in annotations["boxes"].values() for corner in box.values()]
    for group in groups:
        yield from zip(np.reshape(np.array(group["world_m"], float), (-1, 3)),
                       np.array(group["pixels"], float).reshape(-1, 2))


def test_annotations_are_projections_of_their_world_points(annotations, camera):
    world, pixels = (np.array(column) for column in zip(*marked_points(annotations)))
    # The files hold nine decimals; 0.01 pixel is far below what anyone can click.
    np.testing.assert_allclose(camera.project(world)[0], pixels, atol=0.01)


def test_annotated_edges_follow_their_axes(annotations):
    for edge in annotations["edges"]:
        a, b = np.array(edge["world_m"])
        assert np.flatnonzero(np.abs(b - a) > 1e-9).tolist() == ["xyz".index(edge["axis"])]
    assert {edge["axis"] for edge in annotations["edges"]} == set("xyz")


def test_sun_patch_is_where_the_photograph_is_sunlit(photograph, truth, camera):
    patch = truth["lights"]["sun"]["patch_corners_m"]
    inside = pixels_well_within(camera, patch, 1.5)
    near = pixels_well_within(camera, patch, -12) & ~pixels_well_within(camera, patch, -1.5)
    lit, unlit = photograph[inside].mean(-1), photograph[near].mean(-1)
    # Tiles differ by a factor 0.38/0.30 and grout is darker; a sunlit pixel still outshines every other.
    assert lit.min() > 1.5 * unlit.max()
    assert 3 < np.median(lit) / np.median(unlit) < 6


def test_sun_step_across_the_patch_edge_is_irradiance_times_albedo(photograph, truth, camera):
    sun = truth["lights"]["sun"]
    inside = pixels_well_within(camera, sun["patch_corners_m"], 1.5)
    near = pixels_well_within(camera, sun["patch_corners_m"], -12) & ~pixels_well_within(
        camera, sun["patch_corners_m"], -1.5)
    step = photograph[inside].mean(0) - photograph[near].mean(0)
    expected = np.array(truth["albedo"]["floor"]) * sun["irradiance_on_floor_photo_unit_sr"] / np.pi
    # A dozen tiles of random shade (12 % apart at most from their mean) do not average out: some 6 %.
    np.testing.assert_allclose(step, expected, rtol=0.10)


def test_shipped_json_is_what_the_model_says(tmp_path, truth, annotations):
    numbers = render.read_numbers()
    for shipped, made in ((truth, render.truth_of(numbers)), (annotations, render.annotations_of(numbers))):
        render.write_json(tmp_path / "made.json", made)
        assert json.loads((tmp_path / "made.json").read_text()) == shipped


def test_numbers_file_refuses_what_it_cannot_read(tmp_path):
    path = tmp_path / "numbers.inc"
    path.write_text("#declare A = 1;\n#declare B = 2*A;\n")
    with pytest.raises(InputError, match=r"numbers\.inc:2: cannot read '#declare B = 2\*A;'"):
        render.read_numbers(path)


def test_sun_patch_on_furniture_is_refused():
    numbers = render.read_numbers()
    with pytest.raises(InputError, match="may touch the tub"):
        render.sun_patch({**numbers, "Sun_Travel": np.array([1.5, -1, 0.15])})


@pytest.mark.skipif(shutil.which("povray") is None, reason="needs POV-Ray")
def test_sublights_give_the_irradiance_of_the_rectangle(tmp_path):
    """POV-Ray's floor under a Lambertian lamp against Gauss-Legendre quadrature of its form factor."""
    (tmp_path / "lamp.pov").write_text("""#version 3.7;
        #include "lights.inc"
        global_settings { assumed_gamma 1 }
        camera { orthographic location <0, 0.001, 0> direction -y right 4*x up -4*z }
        plane { y, 0 pigment { rgb 1 } finish { ambient 0 diffuse 1 } }
        Lambertian_Rectangle(<-.25, 2.4, -.2>, <.5, 0, 0>, <0, 0, .4>, 6, 6, <10, 10, 10>)""")
    subprocess.run(["povray", "lamp.pov", f"+L{SCENE / 'model'}", "+W21", "+H21", "-D", "+FE", "+Olamp.exr"],
                   cwd=tmp_path, check=True, capture_output=True)
    from_povray = np.pi * read_exr(tmp_path / "lamp.exr")[..., 0]

    x = (np.arange(21) - 10) * 4 / 21
    node, weight = np.polynomial.legendre.leggauss(24)
    lamp_x, lamp_z = np.meshgrid(0.25 * node, 0.2 * node)
    area = np.outer(weight, weight) * 0.25 * 0.2
    floor_x, floor_z = np.meshgrid(x, x)
    squared = (floor_x[..., None, None] - lamp_x)**2 + (floor_z[..., None, None] - lamp_z)**2 + 2.4**2
    irradiance = (10 * 2.4**2 / squared**2 * area).sum((-1, -2))
    # 36 sub-lights 8 cm apart at 2.4 m, in half floats: measured 0.0007.
    np.testing.assert_allclose(from_povray, irradiance, rtol=0.002)
