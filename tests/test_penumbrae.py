"""What T is just beyond the last pixels that a render says are lit."""

import numpy as np
import pytest

from pipeline.physics.penumbrae import FADE, carried

HEIGHT, WIDTH = 40, 200
REACH = FADE * WIDTH


def wall(jump_at: int | None = None) -> np.ndarray:
    """Points (40, 200, 3) [m] of a wall 4 m away, a centimetre a pixel; beyond a column it stands 2 m farther."""
    y, x = np.mgrid[:HEIGHT, :WIDTH] * 0.01
    z = np.where(np.arange(WIDTH) >= (jump_at or WIDTH), -6.0, -4.0)
    return np.stack([x, y, np.broadcast_to(z, x.shape)], -1)


def of_half(points, lit: int = 100, ratio=(0.9, 0.8, 1.2)) -> np.ndarray:
    known = np.broadcast_to(np.arange(WIDTH) < lit, (HEIGHT, WIDTH))
    values = np.where(known[..., None], ratio, 1.0)
    return carried(values, known, points, np.full((HEIGHT, WIDTH), 0.01))


def test_it_goes_on_without_a_step_and_fades_to_the_middle_of_the_lamp():
    found = of_half(wall())
    assert np.array_equal(found[:, :100], np.broadcast_to((0.9, 0.8, 1.2), (HEIGHT, 100, 3)))
    across = np.log(found[20, 100:])
    assert np.allclose(across[0], (1 - 1 / REACH) * np.log((0.9, 0.8, 1.2)), atol=1e-6)
    assert (np.diff(np.abs(across), axis=0) <= 1e-12).all() and (found[:, 100 + int(np.ceil(REACH)):] == 1).all()


def test_not_on_to_another_surface():
    assert (of_half(wall(jump_at=100))[:, 100:] == 1).all()
    half_way = of_half(wall(jump_at=102))
    assert (half_way[:, 100:102] != 1).all() and (half_way[:, 102:] == 1).all()


def test_a_slanted_surface_is_one():
    points = wall()
    points[..., 2] -= 2 * points[..., 0]  # 63 degrees off the view
    assert (of_half(points)[:, 100:103] != 1).all()


@pytest.mark.parametrize("known", [True, False])
def test_nothing_to_carry(known):
    values = np.full((4, 5, 3), 0.7)
    found = carried(values, np.full((4, 5), known), np.zeros((4, 5, 3)), np.ones((4, 5)))
    assert np.array_equal(found, values if known else np.ones((4, 5, 3)))


def test_black_is_carried_as_a_number():
    known = np.broadcast_to(np.arange(WIDTH) < 100, (HEIGHT, WIDTH))
    assert np.isfinite(carried(np.zeros((HEIGHT, WIDTH, 3)), known, wall(), np.full((HEIGHT, WIDTH), 0.01))).all()
