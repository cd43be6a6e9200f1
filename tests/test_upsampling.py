"""Maps made small, at the photograph's size: smooth along a thing, sharp at its edge, and of the right thing beside it."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.physics.upsampling import Enlargement

NEAR, FAR = 20.0, 250.0


def of(coarse_depth, depth, values):
    return Enlargement(np.asarray(coarse_depth, float), np.asarray(depth, float)).of(np.asarray(values, float))


@pytest.mark.parametrize("channels", [1, 3])
def test_on_one_thing_it_is_bilinear(channels):
    y, x = np.mgrid[:9, :12].astype(float)
    slope = np.stack([1 + x + 3 * y] * channels, -1)
    found = of(np.full((9, 12), FAR), np.full((36, 48), FAR), slope)
    rows, columns = np.mgrid[:36, :48]
    true = 1 + np.clip((columns + 0.5) / 4 - 0.5, 0, 11) + 3 * np.clip((rows + 0.5) / 4 - 0.5, 0, 8)
    assert found.shape == (36, 48, channels) and found[..., 0] == pytest.approx(true, rel=1e-6)


def test_an_edge_of_depth_stays_sharp():
    coarse, fine = np.full((8, 8), NEAR), np.full((64, 64), NEAR)
    coarse[:, 4:], fine[:, 30:] = FAR, FAR
    found = of(coarse, fine, np.where(coarse == FAR, 5.0, 1.0)[..., None])
    assert found[:, :30] == pytest.approx(1.0) and found[:, 30:] == pytest.approx(5.0)


def test_beside_an_edge_the_same_thing_is_found_farther_round():
    """Leaves that the small map has on all four places round a pixel of the lake behind them."""
    coarse, fine = np.full((16, 16), FAR), np.full((128, 128), FAR)
    coarse[6:9, 6:9] = NEAR
    # the photograph's leaves are smaller than the small map's: round them the lake has no place near it
    fine[60:64, 60:64] = NEAR
    lake = np.broadcast_to(np.linspace(4, 5, 16)[:, None], (16, 16))
    found = of(coarse, fine, np.where(coarse == FAR, lake, 1.0)[..., None])[..., 0]
    shown = fine == FAR
    true = np.interp((np.arange(128) + 0.5) / 8 - 0.5, np.arange(16), np.linspace(4, 5, 16))[:, None] * np.ones(128)
    assert found[shown] == pytest.approx(true[shown], rel=0.05), "no blocks of what the leaves have"
    assert found[60:64, 60:64] == pytest.approx(1.0)


def test_where_nothing_is_alike_the_likest_stands():
    coarse = np.full((6, 6), NEAR)
    coarse[2, 3] = 100.0
    found = of(coarse, np.full((60, 60), FAR), np.where(coarse == NEAR, 1.0, 2.0)[..., None])[..., 0]
    assert found[25, 35] == pytest.approx(2.0) and found[55, 2] == pytest.approx(1.0), "too far off"
    assert np.isfinite(found).all()


def test_maps_of_one_row_or_pixel():
    assert of([[NEAR]], np.full((5, 7), FAR), [[[3.0]]]) == pytest.approx(3.0)
    assert of([[NEAR, FAR]], [[NEAR, NEAR, FAR, FAR]], [[[1.0], [2.0]]])[..., 0] == pytest.approx(np.array([[1, 1, 2, 2]]))
