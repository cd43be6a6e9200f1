"""Outlines that are no outlines, and suns that explain no patch: each is refused in one line, or means the same."""

from __future__ import annotations

import copy

import numpy as np
import pytest

from pipeline.imaging.maps import read_map
from tests.extreme_scenes import LIGHTS, fog, fogged, room, status, sun, written
from tests.test_bad_input import refusal

CEILING = [[-0.25, 2.39, -1.7], [0.25, 2.39, -1.7], [0.25, 2.39, -1.3], [-0.25, 2.39, -1.3]]
POINTS = {
    "one point thrice": ([[0, 2.3, -1]] * 3, "distinct points, and a polygon needs 3"),
    "collinear": ([[0, 2.3, -1], [0.5, 2.3, -1], [1, 2.3, -1]], "all 3 points lie on one line"),
    "crossing": ([CEILING[0], CEILING[2], CEILING[1], CEILING[3]], "its edges cross"),
    "not plane": ([*CEILING[:3], [-0.25, 1.9, -1.3]], "off a common plane"),
    "back along itself": ([CEILING[0], CEILING[1], CEILING[2], CEILING[1]], "its edges cross"),
}
PIXELS = {
    "one point thrice": ([[5, 1]] * 3, "distinct points, and a polygon needs 3"),
    "collinear": ([[2, 1], [4, 1], [8, 1]], "all 3 points lie on one line"),
    "crossing": ([[6, 0], [10, 1], [10, 0], [6, 1]], "its edges cross"),
    "beyond the horizon": ([[6, 11], [10, 11], [10, 10], [6, 10]], "on or beyond the horizon of room.ceiling"),
}


def lamp(outline: dict) -> dict:
    return {"area": {**copy.deepcopy(LIGHTS["area"]), "outline": outline}}


@pytest.mark.parametrize("case", POINTS)
def test_outline_in_metres_is_refused(case, tmp_path, capsys):
    points, says = POINTS[case]
    build = written(tmp_path, room(lamp({"points": points}), fog(0.2)))
    code = status(build)
    message = refusal(code, capsys.readouterr().err, tmp_path)
    assert says in message and "area.outline" in message, message


@pytest.mark.parametrize("case", PIXELS)
def test_outline_in_pixels_is_refused(case, tmp_path, capsys):
    pixels, says = PIXELS[case]
    build = written(tmp_path, room(lamp({"on": "room.ceiling", "pixels": pixels}), fog(0.2)))
    code = status(build)
    message = refusal(code, capsys.readouterr().err, tmp_path)
    assert says in message, message


@pytest.mark.parametrize("side", ["points", "pixels"])
def test_reversed_outline_means_the_same(side, tmp_path):
    outline = {"points": CEILING} if side == "points" else {
        "on": "room.ceiling", "pixels": [[6, 0], [10, 0], [9, 1], [7, 1]]}
    knobs = {"samples": 4, "glow_tolerance": 1e-3, "shadow_lights": 5, "transmittance": "area"}
    backwards = {**outline, side: outline[side][::-1]}
    pictures = [fogged(written(tmp_path / name, room(lamp(one), fog(0.2), render=knobs)))
                for name, one in (("forwards", outline), ("backwards", backwards))]
    for one, other in zip(*pictures):
        # the cells' grid may begin at another corner: rounding of half floats
        np.testing.assert_allclose(other, one, rtol=5e-3, atol=2e-3 * one.max())


def test_outline_beyond_the_photograph(tmp_path):
    """What lies outside the frame is as real as what lies inside."""
    build = written(tmp_path, room(lamp({"on": "room.ceiling", "pixels": [[-6, -9], [30, -9], [24, -4], [-2, -4]]}),
                                   fog(0.2)))
    _, v, _ = fogged(build)
    assert v.max() > 0 and (read_map(build.surfaces)[..., 1] == -1).all()


@pytest.mark.parametrize("patch, says", [
    ([[-1.5, 0.2, -2.4], [-1.5, 0.6, -2.4], [-1.5, 0.6, -1.5], [-1.5, 0.2, -1.5]], "no volume"),
    ([[1.2, 0, -2.9], [1.2, 0, -2.9], [1.2, 0, -2.9]], "distinct points"),
    ([[0, 0, -2], [1, 0, -2], [0.5, 0, -2]], "lie on one line"),
])
@pytest.mark.parametrize("stated", [True, False], ids=["direction stated", "direction sought"])
def test_patches_that_are_none(patch, says, stated, tmp_path, capsys):
    light = sun([0.63, -0.76, 0.11])
    light["openings"]["window"]["patches"] = [{"points": patch}]
    if not stated:
        del light["direction"]
    build = written(tmp_path, room({"sun": light}, fog(0.2)))
    code = status(build)
    message = refusal(code, capsys.readouterr().err, tmp_path)
    # on the window's own wall: sought, no direction is found; stated, there is no volume to light
    assert says in message or (not stated and "no sun direction explains the patches" in message), message


def test_patches_that_no_sun_explains(tmp_path, capsys):
    """Two windows side by side whose patches lie in opposite directions."""
    light = sun([0.63, -0.76, 0.11])
    del light["direction"]
    other = copy.deepcopy(light["openings"]["window"])
    window = np.array(other["window"]["points"]) + [0, 0, 1.5]
    other = {"window": {"points": window.tolist()},
             "patches": [{"points": [[-1.2, 0, 1.5], [-1.2, 0, 1.4], [-1.1, 0, 1.4], [-1.1, 0, 1.5]]}]}
    light["openings"]["other"] = other
    build = written(tmp_path, room({"sun": light}, fog(0.2)))
    code = status(build, "resolve", "photograph", "camera", "geometry", "sun_direction")
    message = refusal(code, capsys.readouterr().err, tmp_path)
    assert "no sun direction explains the patches" in message and "'other'" in message, message
    assert "correct the window and patch polygons, or give the light a 'direction'" in message
