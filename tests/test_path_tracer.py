"""The path tracer that validation measures single scattering against: its shares by quadrature, its total by Mitsuba 3."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from pipeline.imaging.maps import read_map
from tests.reference import quadrature as q
from tests.reference.path_tracer import SHARES, Fog, trace

STORED = Path(__file__).parent / "reference" / "multiple_scattering"
ROOM = q.cornell_room()


@pytest.mark.parametrize("fog", [Fog(0.05, 0.1), Fog(0.4, 0.3, 0.6), Fog(0.1, 0.4, 0.0, scale_height=0.6)])
def test_direct_and_single_light_as_by_quadrature(fog):
    rays = ROOM.rays(16, 16)
    occluders = ROOM.polygons[:ROOM.lamp_polygon]
    halves = np.stack([trace(ROOM, rays, fog, 128, seed) for seed in (1, 2)])
    direct, single = halves[:, 0][:, rays.surface()], halves[:, SHARES.index("single")][:, ~rays.emitter]
    hit = q.cast(rays.origin, rays.directions, ROOM.polygons)[1][rays.surface()]
    irradiance = q.direct_irradiance(ROOM.lamp, rays.points(rays.surface()), rays.normals[rays.surface()], occluders,
                                     fog.medium())
    path = rays.depth * q.mean_density(rays.origin[1], rays.points()[:, 1], fog.scale_height)
    exact = ROOM.albedos[hit] / np.pi * irradiance * np.exp(-fog.extinction * path[rays.surface()])[:, None]
    glow = q.in_scattering(rays, fog.medium(), ROOM.lamp, occluders)[~rays.emitter]
    # sums over the picture: their noise at so many paths is 0.2 % and 2 %
    assert abs(direct.mean(0).sum() / exact.sum() - 1) < 0.01
    assert abs(single.mean(0).sum() / glow.sum() - 1) < 0.06


def closed_room() -> q.Room:
    """The room of tests/reference/multiple_scattering/render.py."""
    low, high = np.array([-1.5, 0, -3]), np.array([1.5, 2.4, 1.6])
    polygons = []
    for axis in range(3):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        for side in (low, high):
            corners = np.empty((4, 3))
            corners[:, axis] = side[axis]
            corners[:, i] = np.array([low, high, high, low])[:, i]
            corners[:, j] = np.array([low, low, high, high])[:, j]
            polygons.append(corners)
    lamp = q.RectangleLight((-0.25, 2.39, -1.7), (0.5, 0, 0), (0, 0, 0.4), (17.0, 12.0, 7.0))
    polygons.append(np.array([(-0.25, 2.39, -1.7), (0.25, 2.39, -1.7), (0.25, 2.39, -1.3), (-0.25, 2.39, -1.3)]))
    return q.Room(polygons, np.array([(0.6, 0.5, 0.4)] * 6 + [(0.0, 0.0, 0.0)]), lamp, 6, np.array([0.03, 1.43, 1.3]),
                  np.array([0.02, 1.1, -2.0]), 65.0)


@pytest.mark.parametrize("name, scattering", [("clear", 0.0), ("fog_0.1", 0.1), ("fog_0.3", 0.3)])
def test_all_orders_as_by_mitsuba(name, scattering):
    room = closed_room()
    rays = room.rays(48, 36)
    ours, theirs = trace(room, rays, Fog(0.0, scattering), 256, 3).sum(0), read_map(STORED / f"{name}.exr").reshape(-1, 3)
    # theirs are means over pixels, ours their centres: left out where the lamp's outline may run through them
    away = cv2.dilate(rays.emitter.reshape(36, 48).astype(np.uint8), np.ones((5, 5))).ravel() == 0
    ratio = ours[away].sum(0) / theirs[away].sum(0)
    assert np.all(np.abs(ratio - 1) < 0.005), ratio
    place = np.arange(48 * 36)
    quarter = (place // 48 // 18) * 2 + place % 48 // 24
    for part in (np.flatnonzero((quarter == k) & away) for k in range(4)):  # of noise alone 1 %
        assert np.allclose(ours[part].sum(0) / theirs[part].sum(0), 1, atol=0.03)
