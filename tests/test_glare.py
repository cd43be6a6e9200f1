"""The image of small lamps: told apart from what is behind them, and dimmed by the fog before the lamp alone."""

from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.geometry.camera import from_field_of_view
from pipeline.imaging.glare import glare
from pipeline.physics.layers import mixed_transmittance
from pipeline.scene.artefacts import Edges

VIEW = from_field_of_view(120, 90, 50, camera_height=1.6)
SKY, LAMP = np.array([0.02, 0.025, 0.05]), np.array([0.9, 0.7, 0.3])


def lamp_at(u, v, distance, radius=0.05):
    position = VIEW.position + distance * VIEW.directions(np.array([u, v], float))
    return SimpleNamespace(bulbs=lambda: (position[None], radius))


def spot(u, v, width=0.4):
    off = np.linalg.norm(VIEW.pixel_centres() - [u, v], axis=-1)
    return SKY + LAMP * np.exp(-0.5 * (off / width) ** 2)[..., None]


def plain(photograph, depth):
    return Edges(np.ones(depth.shape), depth.copy(), depth.copy(), photograph.copy(), photograph.copy())


@pytest.mark.parametrize("at", [(60.3, 40.7), (0.5, 0.5), (119.5, 20.2)], ids=["inside", "corner", "border"])
def test_a_lamp_before_the_sky(at):
    """Its light is dimmed by the 30 m before it, and the sky's by all of it."""
    photograph, depth = spot(*at), np.full((90, 120), 2000.0)
    found = glare(VIEW, {"lamp": lamp_at(*at, 30.0)}, depth, photograph)
    row, column = int(at[1]), int(at[0])
    assert found.light[row, column] == 0 and found.distance[row, column] == pytest.approx(30.0)
    # the background is the median round it, to which the spot adds next to nothing
    assert found.radiance[row, column] == pytest.approx(photograph[row, column] - SKY, rel=1e-3)
    edges = plain(photograph, depth).with_glare(found, photograph)
    near, far = np.exp(-0.05 * edges.front_depth)[..., None], np.exp(-0.05 * edges.behind_depth)[..., None]
    t = mixed_transmittance(edges.alpha, edges.front, edges.behind, near, far)
    expected = (photograph[row, column] - SKY) * np.exp(-1.5) + SKY * np.exp(-100)
    assert (t * photograph)[row, column] == pytest.approx(expected, rel=1e-3)
    # V is that of the whole ray: the lamp covers next to nothing of what is behind it
    assert edges.alpha[found.light >= 0].max() < 1e-3 and (edges.behind_depth == depth).all()
    mixed = edges.alpha[..., None] * edges.front + (1 - edges.alpha[..., None]) * edges.behind
    assert mixed == pytest.approx(photograph, abs=1e-9)


def test_far_from_it_nothing_is_its_light():
    photograph = spot(60, 40) + 0.3 * (np.arange(120) > 100)[:, None]
    found = glare(VIEW, {"lamp": lamp_at(60, 40, 30.0)}, np.full((90, 120), 2000.0), photograph)
    off = np.linalg.norm(VIEW.pixel_centres() - [60, 40], axis=-1)
    assert (found.light[off > 6] == -1).all() and (found.radiance[off > 6] == 0).all()


def test_a_hidden_lamp_and_one_behind_the_camera_show_nothing():
    photograph, depth = spot(60, 40), np.full((90, 120), 20.0)
    assert (glare(VIEW, {"lamp": lamp_at(60, 40, 30.0)}, depth, photograph).light == -1).all()
    assert (glare(VIEW, {"lamp": lamp_at(60, 40, -30.0)}, depth, photograph).light == -1).all()


def test_of_two_lamps_the_brighter_counts_at_each_pixel():
    photograph = np.maximum(spot(58, 40), spot(63, 40))
    lamps = {"left": lamp_at(58, 40, 30.0), "right": lamp_at(63, 40, 60.0)}
    found = glare(VIEW, lamps, np.full((90, 120), 2000.0), photograph)
    assert found.distance[40, 57] == pytest.approx(30) and found.distance[40, 63] == pytest.approx(60)


def test_in_a_black_or_even_photograph_there_is_none():
    for value in (0.0, 1.0):
        found = glare(VIEW, {"lamp": lamp_at(60, 40, 30.0)}, np.full((90, 120), 2000.0), np.full((90, 120, 3), value))
        assert (found.radiance == 0).all()
