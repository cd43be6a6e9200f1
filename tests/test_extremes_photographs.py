"""Photographs of every awkward size, brightness and file, from the file to the foggy picture."""

from __future__ import annotations

import copy

import imagecodecs
import numpy as np
import pytest

from pipeline.imaging.maps import read_map
from tests.extreme_scenes import LIGHTS, depth, fog, fogged, room, status, written
from tests.test_bad_input import refusal
from tests.test_fog_off import written as stored

EXTINCTION = 0.2
AMBIENT = {"ambient": copy.deepcopy(LIGHTS["ambient"])}
RADIANCE = np.array([3.0, 2.0, 1.0])


def through_fog(tmp_path, file: str, codes: np.ndarray, lights=None, rtol=1e-6, **attributes):
    """Photograph, T, V and C of a file in known, even light; rtol: of maps as they are stored."""
    build = written(tmp_path, {**room(lights or AMBIENT, fog(EXTINCTION)), "photograph": {"file": file}})
    (build.source / "photograph.exr").unlink()
    stored(build.source / file, codes, **attributes)
    t, v, c = fogged(build, rtol=rtol)
    tau = EXTINCTION * depth(build)
    np.testing.assert_allclose(t, np.broadcast_to(np.exp(-tau), t.shape), rtol=rtol)
    np.testing.assert_allclose(v, RADIANCE * -np.expm1(-tau), rtol=rtol)
    assert build.foggy(".png").stat().st_size > 0
    return build, t, v, c


def values(dtype: str, channels: int = 3, height: int = 12, width: int = 16, level: float | None = None):
    top = 1.0 if dtype == "float" else np.iinfo(dtype).max
    fraction = np.random.default_rng(3).random((height, width, channels)) if level is None else np.full(
        (height, width, channels), level)
    return (fraction * top).astype(np.float32 if dtype == "float" else dtype)


@pytest.mark.parametrize("height, width", [(1, 1), (1, 16), (16, 1), (1, 2), (2, 1), (1, 500)])
@pytest.mark.parametrize("file, dtype", [("photograph.png", "uint8"), ("photograph.exr", "float")])
def test_smallest(height, width, file, dtype, tmp_path):
    build, t, _, _ = through_fog(tmp_path, file, values(dtype, 3, height, width))
    assert t.shape == (height, width, 3)


@pytest.mark.parametrize("height, width", [(1, 1), (1, 16), (16, 1)])
def test_smallest_with_a_lamp(height, width, tmp_path):
    build = written(tmp_path, room({"point": copy.deepcopy(LIGHTS["point"])}, fog(EXTINCTION)),
                    values("float", 3, height, width))
    t, v, _ = fogged(build)
    assert t.shape == (height, width, 3) and v.max() > 0


@pytest.mark.parametrize("level, expected", [(0.0, 0.0), (1.0, 1.0)], ids=["black", "clipped"])
@pytest.mark.parametrize("file, dtype", [("photograph.png", "uint8"), ("photograph.png", "uint16"),
                                         ("photograph.jpg", "uint8"), ("photograph.exr", "float")])
def test_black_and_clipped(file, dtype, level, expected, tmp_path):
    build, t, v, c = through_fog(tmp_path, file, values(dtype, level=level))
    np.testing.assert_allclose(read_map(build.photograph), expected, atol=1e-6)
    np.testing.assert_allclose(c, expected * t + v, rtol=1e-6)


@pytest.mark.parametrize("level", [0.0, 1.0], ids=["black", "clipped"])
def test_black_and_clipped_where_light_is_estimated(level, tmp_path, capsys):
    """Neither tells how strong a light is: one line says so, and what its pixels are."""
    lights = {"point": copy.deepcopy(LIGHTS["point"])}
    del lights["point"]["intensity"]
    scene = room(lights, fog(EXTINCTION))
    del scene["illumination"]
    build = written(tmp_path, {**scene, "photograph": {"file": "photograph.png"}})
    stored(build.source / "photograph.png", values("uint8", level=level))
    code = status(build)
    message = refusal(code, capsys.readouterr().err, tmp_path)
    assert "no pixel of the photograph can be used to estimate lights" in message
    assert f"clipped {100 * level:.0f}%" in message


@pytest.mark.parametrize("file", ["photograph.exr", "photograph.tif"])
def test_nan_and_infinity(file, tmp_path):
    radiance = values("float")
    radiance[0, 0], radiance[3, 4], radiance[5, 6], radiance[7, 7, 1] = np.nan, np.inf, -np.inf, np.nan
    build, t, v, c = through_fog(tmp_path, file, radiance)
    ill = ~np.isfinite(radiance).all(-1)
    # what has no value lets only the fog be seen; its neighbours keep theirs
    np.testing.assert_allclose(c[ill], v[ill], rtol=1e-6)
    np.testing.assert_allclose(c[~ill], (radiance * t + v)[~ill], rtol=1e-6)


@pytest.mark.parametrize("file, dtype, channels, attributes", [
    ("photograph.png", "uint8", 4, {}), ("photograph.tif", "uint16", 4, {}),
    ("photograph.png", "uint16", 2, {}), ("photograph.png", "uint8", 1, {}), ("photograph.jpg", "uint8", 1, {}),
    ("photograph.png", "uint8", 3, {"profile": True})])
def test_channels(file, dtype, channels, attributes, tmp_path):
    codes = values(dtype, channels)
    build, _, _, c = through_fog(tmp_path, file, codes, **attributes)
    if channels <= 2:  # grey in, coloured fog out
        radiance = read_map(build.photograph)
        assert np.array_equal(radiance[..., 0], radiance[..., 2]) and np.ptp(c, axis=-1).max() > 0


def test_alpha_of_an_exr_binds_the_foggy_colours_too(tmp_path):
    codes = values("float", 4)
    codes[0, 0, 3], codes[0, 1, 3] = 0, 1
    build = written(tmp_path, room(AMBIENT, fog(EXTINCTION)))
    (build.source / "photograph.exr").unlink()
    stored(build.source / "photograph.exr", codes)
    assert status(build) == 0
    radiance, t, v, c = (read_map(path) for path in (build.photograph, build.transmittance, build.in_scattering(),
                                                     build.foggy(".exr")))
    # stored as the photograph was: colours times alpha, float32; what glows at alpha 0 cannot be divided by it
    alpha = np.where(codes[..., 3:] > 0, codes[..., 3:], 1)
    np.testing.assert_allclose(c, alpha * (radiance * t + v), rtol=1e-5)


@pytest.mark.parametrize("orientation, turned", [(1, False), (3, False), (6, True), (8, True)])
def test_turned_by_exif(orientation, turned, tmp_path):
    build, t, _, _ = through_fog(tmp_path, "photograph.jpg", values("uint8"), Orientation=orientation)
    assert t.shape == ((16, 12, 3) if turned else (12, 16, 3))


def test_wide_gamut(tmp_path):
    """Colours outside Rec.709 are negative there and stay so until fog covers them."""
    codes = values("uint8")
    codes[:, :] = (0, 255, 0)
    build = written(tmp_path, {**room(AMBIENT, fog(EXTINCTION)),
                               "photograph": {"file": "photograph.png", "colour_space": "adobe_rgb"}})
    (build.source / "photograph.exr").unlink()
    stored(build.source / "photograph.png", codes)
    t, v, c = fogged(build)
    radiance = read_map(build.photograph)
    assert radiance.min() < -0.3
    np.testing.assert_allclose(c, radiance * t + v, rtol=1e-5, atol=1e-6)


def test_cmyk_is_refused(tmp_path, capsys):
    build = written(tmp_path, {**room(AMBIENT, fog(EXTINCTION)), "photograph": {"file": "photograph.jpg"}})
    (build.source / "photograph.jpg").write_bytes(
        imagecodecs.jpeg8_encode(values("uint8", 4), colorspace="cmyk", outcolorspace="cmyk"))
    code = status(build)
    assert "a CMYK photograph; convert it to RGB" in refusal(code, capsys.readouterr().err, tmp_path)


@pytest.mark.slow
def test_fifty_megapixels(tmp_path):
    rows = np.linspace(0, 255, 6144).astype(np.uint8)
    codes = np.broadcast_to(rows[:, None, None], (6144, 8192, 3))
    # half floats
    build, t, _, _ = through_fog(tmp_path, "photograph.jpg", codes, rtol=1e-3)
    assert t.shape == (6144, 8192, 3)
