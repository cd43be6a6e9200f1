"""The project's models in fog: geometry of the rays, light that arrives in the fog, and `make truth`."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.imaging.maps import read_map
from pipeline.paths import Build
from pipeline.imaging.photograph import averaged
from pipeline.plugins.registry import registry
from pipeline.scene.artefacts import write_json
from tests.reference import path_tracer
from tests.reference import quadrature as q
from tests.validation import ground_truth
from tests.validation.foggy_model import Quality, _Group, in_fog
from tests.validation.models import MODELS, SCENES
from tests.validation.truth import ROOM, Truth

QUICK = Quality(size=8, rays=1, directions=24, rounds=1, count=8, coarser=4)


def fog(absorption: float, scattering: float, **more):
    return registry("media")["homogeneous"](absorption_coefficient=[absorption] * 3, scattering_coefficient=[scattering] * 3,
                                            phase_function={"type": "isotropic"}, **more)


def group(scene: str, medium, folder, quality: Quality = QUICK, **changed) -> _Group:
    model = replace(MODELS[scene](), **changed)
    return _Group(model, model.groups[0], medium, quality, folder, (quality.size, quality.size))


# ---- rays ------------------------------------------------------------------------------------------

def test_eye_rays_are_as_long_as_they_are(tmp_path):
    found = group("cornell", fog(0.1, 0), tmp_path)._depth()
    true = ROOM.rays(8, 8).depth.reshape(8, 8)
    # two half floats of 0.4, 0.0002 each, times ten
    np.testing.assert_allclose(found[np.isfinite(true)], true[np.isfinite(true)], atol=0.005)


def test_each_point_looks_along_each_direction(tmp_path):
    """Lit by nothing, black but for a medium that shines a tenth a metre: what is seen is how far it is."""
    one = group("cornell", fog(0.1, 0), tmp_path, farthest=9.0)
    points, directions = one._points(), one._directions()
    shine = f"media {{ emission rgb 0.1 / {one.model.metre} intervals 1 samples 1 method 2 jitter 0 }}\n"
    flat = "global_settings { radiosity { count 1 recursion_limit 1 pretrace_start 1 pretrace_end 1 media off } }\n"
    size, switches = (len(points) * len(directions), 1), {"Lights": 1, "Emitters_Seen": 0}
    rays = one._mesh_camera(points, directions) + flat + one._backdrop()
    far = 10 * (one._render(size, rays + shine, switches) - one._render(size, rays, switches))[0, :, 1]
    true = np.concatenate([q.cast(point, directions, ROOM.polygons)[0].depth for point in points])
    inside = np.isfinite(true)
    # half floats, as above; a ray that grazes an edge may pass it by
    assert inside.sum() > 300 and np.mean(np.abs(far - true)[inside] < 0.01) > 0.99


# ---- light in the fog -------------------------------------------------------------------------------

def test_above_the_houses_the_sky_arrives_from_above(tmp_path):
    sky = np.array(MODELS["building"]().groups[0].sky)
    one = group("building", fog(0.0, 0.03), tmp_path, nodes=(np.array([-1, 1.0]), np.array([40, 60.0]), np.array([-20, -40.0])))
    arriving = one._arriving(None)
    np.testing.assert_allclose(arriving[:, one._directions()[:, 1] > 0.3], np.broadcast_to(
        sky, (8, (one._directions()[:, 1] > 0.3).sum(), 3)), rtol=1e-3)  # a half float
    # light of one radiance from everywhere arrives so by any phase function
    np.testing.assert_allclose(one._towards_eye(np.broadcast_to(sky, arriving.shape)), np.broadcast_to(sky, (8, 3)))


def test_an_even_field_is_integrated_to_its_closed_form(tmp_path, monkeypatch):
    one = group("cornell", fog(0.1, 0.3), tmp_path)
    depth = np.linspace(0, 9, 64).reshape(8, 8)
    monkeypatch.setattr(one, "_depth", lambda: depth)
    field = np.broadcast_to([1.0, 2.0, 0.5], (len(one._points()), 3))
    # 24 nodes of Gauss-Legendre over an exponential: rounding
    np.testing.assert_allclose(one._scattered(field), 0.75 * -np.expm1(-0.4 * depth)[..., None] * [1.0, 2.0, 0.5], rtol=1e-6, atol=1e-9)


def test_points_within_things_are_left_out(tmp_path):
    """On the end house's wall, inside it, and before it."""
    nodes = (np.array([-8.0, -7.0]), np.array([6.0, 7.0]), np.array([-60.0, -69.0]))
    arriving = group("building", fog(0.0, 0.03), tmp_path, nodes=nodes)._arriving(None).mean((1, 2)).reshape(2, 2, 2)
    assert arriving.min() > 0.05 and np.array_equal(arriving[..., 0], arriving[..., 1]), "what is inside takes what is before it"


@pytest.mark.slow
def test_cornell_room_in_fog_against_the_path_tracer():
    """All orders of scattering. POV-Ray's radiosity ends after six bounces and interpolates: some per cent."""
    model = replace(MODELS["cornell"](), farthest=8.0, bounces=6)
    found = in_fog(model, fog(0.05, 0.3), Quality(size=16, directions=100, rounds=3, count=120, coarser=2))
    rays = Truth(32).rays
    true = path_tracer.trace(ROOM, rays, path_tracer.Fog(0.05, 0.3), 1000, 3).sum(0).reshape(16, 2, 16, 2, 3).mean((1, 3))
    seen = true.max(-1) < 3  # not the lamp
    assert abs(np.median(found[seen] / true[seen]) - 1) < 0.04
    # measured: 0.026, of which the tracer's noise is a part
    assert np.sqrt(((found - true)[seen] ** 2).mean() / (true[seen] ** 2).mean()) < 0.05


def test_without_fog_it_is_the_photograph():
    """Of the street, where all is lit directly by the sun; radiosity of eight rays is noise of some per cent of the sky's part."""
    found = in_fog(MODELS["building"](), None, replace(QUICK, size=14, rays=3))
    photograph = read_map(SCENES / "building/photograph.exr").astype(float)
    small = averaged(photograph, found.shape[1::-1])
    assert abs(np.median(found / small) - 1) < 0.03
    assert np.mean(found) == pytest.approx(np.mean(small), rel=0.05)


# ---- make truth -----------------------------------------------------------------------------------

@pytest.fixture
def resolved(tmp_path):
    """A scene called like one of the models, its fog resolved."""
    build = Build("building", None, tmp_path / "scenes", tmp_path / "build")

    def state(described: dict):
        write_json(build.input("fog"), registry("media")[described["type"]].model_validate(described).model_dump(mode="json"))
        return build

    return state


def test_truth_is_rendered_once(resolved, monkeypatch):
    calls = []
    monkeypatch.setattr(ground_truth, "in_fog", lambda model, medium, quality: calls.append(medium) or np.full((4, 4, 3), 0.25))
    build = resolved({"type": "homogeneous", "visibility": 50})
    path = ground_truth.write(build, QUICK)
    assert read_map(path).mean() == 0.25 and json.loads(path.with_suffix(".json").read_text())["fog"]["visibility"] == 50
    ground_truth.write(build, QUICK)
    assert len(calls) == 1
    ground_truth.write(build, replace(QUICK, size=9))
    ground_truth.write(resolved({"type": "homogeneous", "visibility": 60}), replace(QUICK, size=9))
    assert len(calls) == 3, "of another quality or fog it is rendered anew"


@pytest.mark.parametrize("scene, described, says", [
    ("pagoda", {"type": "homogeneous", "visibility": 50}, "the project carries no model of 'pagoda'; ask for one of bathroom"),
    ("building", {"type": "homogeneous", "visibility": float("inf")}, "the fog is clear"),
    ("building", {"type": "height", "visibility": 20, "scale_height": 2, "top_height": 9}, "fog with a top"),
])
def test_refused(scene, described, says, tmp_path):
    build = Build(scene, None, tmp_path / "scenes", tmp_path / "build")
    medium = registry("media")[described["type"]].model_validate(described)
    write_json(build.input("fog"), medium.model_dump(mode="json"))
    with pytest.raises(InputError, match=says):
        ground_truth.write(build, QUICK)
    assert not build.truth.exists()


@pytest.mark.parametrize("size", ["7", "4097", "1e3", "-64", "12345678"])
def test_size_out_of_bounds(size, monkeypatch):
    monkeypatch.setenv("FOG_TRUTH_SIZE", size)
    with pytest.raises(InputError, match=f"FOG_TRUTH_SIZE={size}"):
        ground_truth._size()
