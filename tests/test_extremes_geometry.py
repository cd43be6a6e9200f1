"""Polygons that are none, through the command line: one line each, or the same picture."""

from __future__ import annotations

import re

import imagecodecs
import numpy as np
import pytest

from pipeline.imaging.maps import write_map
from tests.conftest import CHAIN
from tests.extremes.scenes import BULB, described, even, maps, prepared, refusal, run

SQUARE = [[-0.4, 2.49, -3.4], [0.4, 2.49, -3.4], [0.4, 2.49, -2.6], [-0.4, 2.49, -2.6]]


def lamp(points) -> dict:
    return {"lamp": {"type": "area", "outline": {"points": points}, "radiance": [4, 4, 4], "sub_lights": 2},
            "bulb": BULB}


@pytest.mark.parametrize("points,words", [
    ([SQUARE[0]] * 4, "distinct"),
    ([SQUARE[0], [0, 2.49, -3.4], SQUARE[1]], "line"),
    ([SQUARE[0], SQUARE[2], SQUARE[1], SQUARE[3]], "cross"),
    ([[float("nan"), 2, 2], *SQUARE[1:]], "number|finite")],
    ids=["degenerate", "collinear", "self-intersecting", "not a number"])
def test_refused_outlines(tmp_path, capsys, points, words):
    said = refusal(tmp_path, described(lamp(points)), capsys)
    assert re.search(words, said), said


def test_reversed_outline(tmp_path):
    """A lamp shines into the room whichever way round its corners are named."""
    one = run(tmp_path / "one", described(lamp(SQUARE)))
    other = run(tmp_path / "other", described(lamp(SQUARE[::-1])))
    for name in ("transmittance", "in_scattering"):
        # the sub-lights are the same up to their order
        assert np.allclose(getattr(one, name), getattr(other, name), rtol=2e-3), name


def test_lamp_off_the_image(tmp_path):
    """A lamp whose outline lies behind the camera lights the room all the same, and none of it is in the picture."""
    behind = [[x, y, z + 3.4] for x, y, z in SQUARE]
    found = run(tmp_path, described({"lamp": lamp(behind)["lamp"]}))
    assert found.in_scattering.min() > 0
    # fog is 0.5/m and the way to the eye is part of the way of the light
    assert (found.transmittance < np.exp(-0.5 * found.depth)[..., None]).all()


def open_air(folder, depth: np.ndarray, extinction: float, asymmetry: float = 0.0):
    """A scene of this depth map under a sky and over a ground of one radiance."""
    height, width = depth.shape
    scene = {
        "photograph": {"file": "photograph.exr"},
        "camera": {"horizontal_field_of_view": 60, "height": 1.6, "horizon": [[0, height / 2], [width, height / 2]]},
        "depth": {"sky_depth": 3000.0, "map": {"file": "depth.exr", "kind": "radial"}, "labels": "labels.png"},
        "lights": {"sky": {"type": "sky", "radiance": [1, 1, 1]}, "ground": {"type": "ground", "radiance": [1, 1, 1]}},
        "illumination": {"type": "manual"},
        "fog": even(0.25 * extinction, 0.75 * extinction,
                    {"type": "henyey_greenstein", "asymmetry": asymmetry})}
    tiny = prepared(folder, scene, (width, height))
    write_map(tiny.folder / "depth.exr", depth.astype(np.float32), is_depth=True)
    codes = np.full((height, width, 3), (255, 0, 0), np.uint8)
    codes[: height // 3] = (0, 0, 255)
    (tiny.folder / "labels.png").write_bytes(imagecodecs.png_encode(codes))
    return tiny


@pytest.mark.parametrize("extinction,asymmetry", [
    (1e-12, 0.0), (3e-13, 0.999), (0.01, 0.999), (0.01, -0.999), (1e4, 0.0)])
def test_furnace_under_a_sky(tmp_path, extinction, asymmetry):
    """T = exp(-kappa d) and V = delta/kappa L (1 - T), which is delta L d in thin fog, for things and sky."""
    tiny = open_air(tmp_path, np.full((18, 24), 25.0), extinction, asymmetry)
    assert tiny.run(*CHAIN) == 0
    found = maps(tiny)
    sky = found.depth[0]
    assert np.allclose(sky, 3000), "the sky stands where it is said to"
    tau = extinction * found.depth[..., None]
    # float32 maps; skylight's share of the phase function is tabulated to 1e-3
    plain = np.ones((18, 24), bool)
    plain[3:9] = False  # the border between sky and things is two layers
    assert np.allclose(found.transmittance[plain], np.broadcast_to(np.exp(-tau), (18, 24, 3))[plain], rtol=1e-5)
    assert np.allclose((found.in_scattering / -np.expm1(-tau))[plain], 0.75, rtol=4e-3)


def test_depth_of_zero(tmp_path, capsys):
    """What lies at the eye is refused: no thing is 0 m away."""
    tiny = open_air(tmp_path, np.zeros((18, 24)), 0.01)
    assert tiny.run(*CHAIN) != 0
    said = capsys.readouterr().err
    assert "depth" in said and "Traceback" not in said
