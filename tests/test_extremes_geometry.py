"""Polygons that are none, through the command line: one line each, or the same picture."""

from __future__ import annotations

import numpy as np
import pytest

from tests.extremes.scenes import BULB, described, refusal, run

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
    import re
    said = refusal(tmp_path, described(lamp(points)), capsys)
    assert re.search(words, said), said


def test_reversed_outline(tmp_path):
    """A lamp shines into the room whichever way round its corners are named."""
    one = run(tmp_path / "one", described(lamp(SQUARE)))
    other = run(tmp_path / "other", described(lamp(SQUARE[::-1])))
    for name in ("transmittance", "in_scattering"):
        # the sub-lights are the same up to their order
        assert np.allclose(getattr(one, name), getattr(other, name), rtol=2e-3), name
