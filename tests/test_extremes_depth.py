"""Depths from nothing to the sky, from a depth map and through the whole chain."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.imaging.maps import write_map
from tests.extreme_scenes import HEIGHT, WIDTH, fogged, status, written
from tests.test_bad_input import refusal

SKY_DEPTH = 3000.0
#: All round alike: V = L (1 - exp(-tau)) whatever the direction.
#: of an open field, whatever stands in it
EVEN = {name: {"type": name, "radiance": [2.0, 2.0, 2.0], "unobstructed": True} for name in ("sky", "ground")}


def yard(visibility: float = 80.0) -> dict:
    return {"photograph": {"file": "photograph.exr"},
            "camera": {"horizontal_field_of_view": 60, "horizon": [[0, 6], [WIDTH, 6]], "height": 1.6},
            "depth": {"sky_depth": SKY_DEPTH, "refine": {"radius": 0}, "map": {"file": "depth.exr", "kind": "radial"}},
            "lights": EVEN, "illumination": {"type": "manual"},
            "fog": {"type": "homogeneous", "visibility": visibility, "phase_function": {"type": "isotropic"}}}


def mapped(tmp_path, depths: np.ndarray, visibility: float = 80.0):
    build = written(tmp_path, yard(visibility))
    write_map(build.source / "depth.exr", depths.astype(np.float32), is_depth=True)
    return build


@pytest.mark.parametrize("metres", [1e-3, 1.0, 100.0, 2900.0, SKY_DEPTH, 1e6])
@pytest.mark.parametrize("visibility", [0.1, 80.0, 1e7])
def test_one_depth(metres, visibility, tmp_path):
    depths = np.full((HEIGHT, WIDTH), metres)
    depths[-1] = 5.0  # something that is no sky
    build = mapped(tmp_path, depths, visibility)
    t, v, _ = fogged(build)
    tau = -np.log(0.05) / visibility * np.minimum(depths, SKY_DEPTH)[..., None]
    # the map's depths are float32: 6e-8, times an optical depth of up to 90
    np.testing.assert_allclose(t, np.broadcast_to(np.exp(-tau), t.shape), rtol=2e-5, atol=1e-37)
    # half of a level ray's light comes from above: a table of the sky by elevation, 1e-4
    np.testing.assert_allclose(v, np.broadcast_to(2 * -np.expm1(-tau), v.shape), rtol=1e-3)


@pytest.mark.parametrize("value", [0.0, np.nan, np.inf, -1.0])
def test_depths_that_are_none(value, tmp_path, capsys):
    """What the map does not know is asked for, not guessed."""
    depths = np.full((HEIGHT, WIDTH), 25.0)
    depths[:3] = value
    build = mapped(tmp_path, depths)
    code = status(build)
    message = refusal(code, capsys.readouterr().err, tmp_path)
    assert "neither a region nor the depth map covers 25.0% of the photograph, for example pixel" in message
