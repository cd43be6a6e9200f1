"""The street at night: glow of lamps and headlights along lines through them, against the airlight integral."""

import json
from pathlib import Path

import numpy as np
import pytest

from pipeline.cli import main
from pipeline.imaging.maps import read_map
from pipeline.paths import Build
from pipeline.scene.artefacts import read_edges, read_placed
from tests.reference import quadrature as reference

SCENES = Path(__file__).resolve().parent.parent / "scenes"
TRUTH = json.loads((SCENES / "lamps" / "truth.json").read_text())
CHAIN = ("resolve", "photograph", "camera", "geometry", "sun_direction", "illumination", "plan", "emit", "render",
         "decompose")
#: Strengths by hand and no shadows: nothing is rendered, and the glow is the integral alone.
STATED = ["illumination={type: manual}", "lights.street_lamps.intensity=[44, 27, 11]", "lights.street_lamps.shadowed=0",
          "lights.left_headlight.shadows=false", "lights.right_headlight.shadows=false"]
VISIBILITY, ASYMMETRY = 250, 0.7


def run(folder: Path, *overrides: str) -> Build:
    build = Build("lamps", None, SCENES, folder)
    for stage in CHAIN:
        stated = [f"--set={o}" for o in (*STATED, *overrides)] if stage == "resolve" else []
        assert main([stage, "--scene", "lamps", "--scenes", str(SCENES), "--build", str(folder), *stated]) == 0, stage
    return build


@pytest.fixture(scope="module")
def one_lamp(tmp_path_factory) -> Build:
    return run(tmp_path_factory.mktemp("one"), "lights.street_lamps.positions=[{point: %s}]" % TRUTH["lamps"]["position_m"][2])


@pytest.fixture(scope="module")
def all_lamps(tmp_path_factory) -> Build:
    return run(tmp_path_factory.mktemp("all"))


def profile(build: Build, pixel, least=3.0):
    """Rows and columns of the pixels on the horizontal and the vertical line through `pixel`, from `least` pixels out, that
    show one thing each, and the reference's rays through their centres."""
    scene, edges = read_placed(build), read_edges(build)
    camera, (u, v) = scene.camera, pixel
    rows = np.concatenate([np.full(camera.width, int(v)), np.arange(camera.height)])
    columns = np.concatenate([np.arange(camera.width), np.full(camera.height, int(u))])
    far = np.hypot(columns + 0.5 - u, rows + 0.5 - v) >= least
    # a pixel on a border mixes the V of two depths
    whole = ~edges.mixed[rows, columns] | (edges.alpha[rows, columns] < 1e-3)
    rows, columns = rows[far & whole], columns[far & whole]
    directions = camera.directions(np.stack([columns, rows], -1) + 0.5)
    depth = np.where(edges.alpha < 1e-3, edges.behind_depth, edges.front_depth)[rows, columns]
    rays = reference.Rays(camera.position, directions, depth, -directions, np.zeros(len(depth), bool))
    return rows, columns, rays


def medium() -> reference.Medium:
    return reference.Medium(0.0, -np.log(0.05) / VISIBILITY, reference.henyey_greenstein(ASYMMETRY))


def test_glow_of_one_lamp(one_lamp):
    """Within 2 % from 3 pixels out to the frame's edge: the lamp is seen 4 pixels of glare wide."""
    rows, columns, rays = profile(one_lamp, TRUTH["lamps"]["position_pixel"][2])
    assert len(rows) > 800
    lamp = reference.PointLight(np.array(TRUTH["lamps"]["position_m"][2]), np.array([44.0, 27, 11]),
                                TRUTH["lamps"]["radius_m"])
    truth = reference.in_scattering(rays, medium(), lamp)
    found = read_map(one_lamp.in_scattering("street_lamps"))[rows, columns]
    error = np.abs(found / truth - 1)
    assert error.max() < 0.02, np.sort(error.max(-1))[-10:]
    assert np.median(error) < 2e-3


@pytest.mark.parametrize("index", [0, 3, 8])
def test_glow_of_all_lamps(all_lamps, index):
    """Their sum along lines through a near, a middle and a far lamp, as the scene places them by pixels."""
    scene = read_placed(all_lamps)
    lamps = scene.lights["street_lamps"]
    pixel = scene.camera.project(lamps.points[index])[0]
    rows, columns, rays = profile(all_lamps, pixel)
    truth = sum(reference.in_scattering(rays, medium(), reference.PointLight(p, np.array([44.0, 27, 11]), lamps.radius))
                for p in lamps.points)
    found = read_map(all_lamps.in_scattering("street_lamps"))[rows, columns]
    error = np.abs(found / truth - 1)
    assert np.percentile(error, 99) < 0.02 and np.median(error) < 5e-3, np.sort(error.max(-1))[-10:]
    # the lines pass other lamps too, where a pixel's own quadrature is coarser
    assert error.max() < 0.05


def test_glow_of_a_headlight(all_lamps):
    scene = read_placed(all_lamps)
    beam = scene.lights["left_headlight"]
    pixel = scene.camera.project(beam.position.vector)[0]
    rows, columns, rays = profile(all_lamps, pixel)
    axis = beam.target.vector - beam.position.vector
    inner, outer = np.cos(np.radians([beam.inner_angle, beam.outer_angle]))

    def cone(cosine):
        x = np.clip((cosine - outer) / (inner - outer), 0, 1)
        return x * x * (3 - 2 * x)

    light = reference.SpotLight(beam.position.vector, np.array([12.0, 12, 11]), beam.radius,
                                axis / np.linalg.norm(axis), cone, (inner, outer))
    truth = reference.in_scattering(rays, medium(), light)
    found = read_map(all_lamps.in_scattering("left_headlight"))[rows, columns]
    lit = truth.max(-1) > 1e-3 * truth.max()
    error = np.abs(found[lit] / truth[lit] - 1)
    assert error.max() < 0.02, np.sort(error.max(-1))[-10:]


def test_positions_by_pixels_are_near_the_truth(all_lamps):
    """Bulb and the spot below it, clicked to half a pixel: within 3 % of the distance, the farthest within 10 %."""
    found = read_placed(all_lamps).lights["street_lamps"].points
    truth = np.array(TRUTH["lamps"]["position_m"])
    off = np.linalg.norm(found - truth, axis=1) / np.linalg.norm(truth, axis=1)
    assert np.median(off) < 0.03 and off.max() < 0.10


def test_the_plan_says_which_lamps_fog_hides(tmp_path):
    """Visibility 10 m is 0.3/m: lamps beyond 53 m lie behind 16 optical depths."""
    build = run(tmp_path, "fog.visibility=10")
    plan = json.loads(build.plan.read_text())
    far = (np.linalg.norm(np.array(TRUTH["lamps"]["position_m"]) - [0, 1.5, 0], axis=1) > 53.4).sum()
    assert 0 < far < 12
    assert f"street_lamps: {far} of 12 lamps left out, behind 16 optical depths of fog" in plan["reasons"], plan["reasons"]
