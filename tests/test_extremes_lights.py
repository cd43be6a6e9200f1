"""Lamps and suns where they are awkward, cameras above, in and below fog, through the whole chain."""

from __future__ import annotations

import copy

import numpy as np
import pytest

from pipeline.scene.artefacts import read_camera
from tests.extreme_scenes import LIGHTS, depth, fog, fogged, room, status, sun, written
from tests.test_bad_input import refusal

EYE = np.array([0.03, 1.43, 1.3])
EXTINCTION = 0.2


@pytest.mark.parametrize("place", [
    pytest.param([0.02, 1.2, -1.0], id="in view"), pytest.param([0.4, 0.0, -1.4], id="on the floor"),
    pytest.param([-1.5, 1.2, -1.4], id="on a wall"), pytest.param([0.3, 1.4, 1.5], id="behind the camera"),
    pytest.param([-1.4, 1.4, 0.9], id="outside the frame"), pytest.param(EYE.tolist(), id="touching the eye"),
    pytest.param([0.03, 1.43, 1.3 - 1e-6], id="a micrometre before the eye")])
def test_bulb(place, tmp_path):
    light = {**copy.deepcopy(LIGHTS["point"]), "position": {"point": place}}
    build = written(tmp_path, room({"point": light}, fog(EXTINCTION)))
    t, v, _ = fogged(build)
    assert v.max() > 0 and t.max() > 0
    # its light travels at least from the eye to the surface; half floats
    assert (t <= np.exp(-EXTINCTION * depth(build)) * (1 + 2e-3)).all()
    # no more than unattenuated along an endless ray past its centre: I sigma / (4 pi) * pi / radius
    assert (v <= np.array([3.0, 2.0, 1.0]) * EXTINCTION / (4 * 0.02) * 1.02).all()


@pytest.mark.parametrize("corners, faces", [
    pytest.param([[-0.4, 1.8, -2.99], [0.4, 1.8, -2.99], [0.4, 1.0, -2.99], [-0.4, 1.0, -2.99]], None, id="in view"),
    pytest.param([[-0.4, 1.8, -3.0], [0.4, 1.8, -3.0], [0.4, 1.0, -3.0], [-0.4, 1.0, -3.0]], None, id="on the wall"),
    pytest.param([[-0.4, 1.8, 1.5], [0.4, 1.8, 1.5], [0.4, 1.0, 1.5], [-0.4, 1.0, 1.5]], None,
                 id="behind the camera"),
    pytest.param([[-0.2, 1.43, 1.2], [0.2, 1.43, 1.2], [0.2, 1.43, 0.8], [-0.2, 1.43, 0.8]], [0, 0, 0],
                 id="edge-on to the eye"),
    pytest.param([[-0.2, 1.6, 1.3], [0.26, 1.6, 1.3], [0.26, 1.2, 1.3], [-0.2, 1.2, 1.3]], [0, 1, 0],
                 id="round the eye")])
def test_area(corners, faces, tmp_path):
    light = {**copy.deepcopy(LIGHTS["area"]), "outline": {"points": corners}}
    if faces:
        light["faces_towards"] = faces
    build = written(tmp_path, room({"area": light}, fog(EXTINCTION)))
    t, v, _ = fogged(build)
    assert v.max() > 0 and (t <= np.exp(-EXTINCTION * depth(build)) * (1 + 2e-3)).all()
    # fog within a field no brighter than the lamp: at most what even light of its radiance gives
    assert (v <= np.array([3.0, 2.0, 1.0]) * -np.expm1(-EXTINCTION * depth(build)) * 1.02).all()


@pytest.mark.parametrize("direction", [
    pytest.param([0.9, -0.4, 0.05], id="low"), pytest.param([0.63, -0.76, 0.0], id="in the image plane"),
    pytest.param([0.2, -0.97, 0.1], id="steep, nearly along the window's wall")])
def test_sun_through_a_window(direction, tmp_path):
    towards = np.array(direction) / np.linalg.norm(direction)
    build = written(tmp_path, room({"sun": sun(towards)}, fog(EXTINCTION)))
    t, v, _ = fogged(build)
    # single scattering of at most the sun's irradiance, evenly: E / (4 pi)
    assert (v <= np.array([3.0, 2.0, 1.0]) / (4 * np.pi) * -np.expm1(-EXTINCTION * depth(build)) * 1.02).all()
    assert v.max() > 0 and (t <= np.exp(-EXTINCTION * depth(build)) * (1 + 2e-3)).all()


@pytest.mark.parametrize("direction, says", [
    pytest.param([1.0, 0.0, 0.0], "runs along a patch of window 'window'", id="at the horizon, parallel to the floor"),
    pytest.param([0.0, -1.0, 0.0], "does not enter through window 'window'", id="parallel to the window"),
    pytest.param([-0.63, -0.76, 0.11], "does not enter through window 'window'", id="behind the wall"),
    pytest.param([0.63, 0.76, 0.11], "does not come from above the horizon", id="from below"),
    pytest.param([0.0, 0.0, 0.0], "points nowhere", id="no direction")])
def test_sun_that_cannot_shine_through_its_window_is_refused(direction, says, tmp_path, capsys):
    light = sun([0.63, -0.76, 0.11])
    light["direction"] = direction
    build = written(tmp_path, room({"sun": light}, fog(EXTINCTION)))
    code = status(build)
    message = refusal(code, capsys.readouterr().err, tmp_path)
    assert says in message, message


@pytest.mark.parametrize("camera", [0.0, 1.0, 1.43, 2.4])
@pytest.mark.parametrize("kind", ["layers", "height"])
def test_even_light_above_in_and_below_a_layer(camera, kind, tmp_path):
    """T = exp(-kappa x path within the slab); V its complement; camera heights on borders included."""
    lower, upper = (1.43, 2.0) if camera != 1.0 else (0.2, 1.0)
    if kind == "layers":
        medium = {**fog(2.0), "type": "layers", "layers": [{"lower": lower, "upper": upper}]}
    else:
        medium = {**fog(2.0), "type": "height", "base": camera - 0.5, "scale_height": 1e-3}
        lower, upper = -np.inf, camera - 0.5
    scene_data = room({"ambient": copy.deepcopy(LIGHTS["ambient"])}, medium)
    build = written(tmp_path, scene_data)
    t, v, _ = fogged(build)
    eye = read_camera(build)
    ends = eye.position[1] + depth(build)[..., 0] * eye.directions(eye.pixel_centres())[..., 1]
    rise = np.abs(ends - eye.position[1])
    inside = (np.clip(np.maximum(ends, eye.position[1]), lower, upper)
              - np.clip(np.minimum(ends, eye.position[1]), lower, upper))
    tau = (2.0 * inside * depth(build)[..., 0] / np.maximum(rise, 1e-12))[..., None]
    tolerance = 1e-5 if kind == "layers" else 0.02  # a millimetre of fading below the edge is not in the slab
    np.testing.assert_allclose(t, np.broadcast_to(np.exp(-tau), t.shape), rtol=tolerance, atol=tolerance)
    np.testing.assert_allclose(v, np.array([3.0, 2.0, 1.0]) * -np.expm1(-tau), rtol=tolerance, atol=3 * tolerance)
