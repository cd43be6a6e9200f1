"""The street that we made: what is estimated from its photograph and its shipped annotations, against the truth."""

import json
from pathlib import Path

import numpy as np
import pytest

from pipeline.cli import main
from pipeline.imaging.maps import read_map
from pipeline.paths import Build
from pipeline.scene.artefacts import read_fog, read_json

SCENES = Path(__file__).resolve().parent.parent / "scenes"
TRUTH = json.loads((SCENES / "building" / "truth.json").read_text())
ESTIMATES = ("resolve", "photograph", "camera", "geometry", "sun_direction", "illumination")
CHAIN = (*ESTIMATES, "plan", "emit", "render", "decompose")


def run(folder: Path, stages, photograph: str) -> Build:
    build = Build("building", None, SCENES, folder)
    for stage in stages:
        stated = [f"--set=photograph.file={photograph}"] if stage == "resolve" else []
        assert main([stage, "--scene", "building", "--scenes", str(SCENES), "--build", str(folder), *stated]) == 0, stage
    return build


@pytest.fixture(scope="module")
def linear(tmp_path_factory) -> Build:
    return run(tmp_path_factory.mktemp("linear"), CHAIN, "photograph.exr")


@pytest.fixture(scope="module")
def camera_jpeg(tmp_path_factory) -> Build:
    return run(tmp_path_factory.mktemp("jpeg"), ESTIMATES, "photograph.jpg")


@pytest.fixture(scope="module")
def solid():
    """True depth [m], and where it is that of ground and of upright things."""
    depth = read_map(SCENES / "building" / "true_depth.exr").reshape(700, 560).astype(float)
    return depth, depth > 0


@pytest.mark.parametrize("photograph", ["linear", "camera_jpeg"])
def test_strengths(photograph, request):
    """Within 10 % in each channel; walls hide a third of the sky from the shadowed ground and tint it."""
    lights = read_json(request.getfixturevalue(photograph).illumination)["lights"]
    assert lights["sky"]["strength"] == pytest.approx(TRUTH["sky"]["radiance_photo_unit"], rel=0.10)
    assert lights["sun"]["strength"] == pytest.approx(TRUTH["sun"]["irradiance_photo_unit_sr"], rel=0.10)


def test_sun_direction(linear):
    """Clicks are within a pixel of the truth; the stated cone must hold the true direction."""
    sun = read_json(linear.sun_direction)["suns"]["sun"]
    cosine = np.clip(np.dot(sun["sun_direction"], TRUTH["sun"]["direction"]), -1, 1)
    off = np.degrees(np.arccos(cosine))
    assert off < 1.5 and off < sun["confidence_degree"]


def test_depth(linear, solid):
    """Median within 1 %, of each thing within 5 %; a crown's leaves are up to its radius before its trunk."""
    depth, known = solid
    found = read_map(linear.depth).squeeze().astype(float)
    error = np.abs(found[known] / depth[known] - 1)
    labels = read_map(linear.surfaces)[..., 2][known].astype(int)
    assert np.median(error) < 0.01
    for index, name in enumerate(read_json(linear.geometry)["regions"]):
        part = error[labels == index]
        assert part.size < 400 or np.median(part) < (0.12 if "tree" in name else 0.05), name
    assert np.percentile(error, 90) < 0.10


def test_transmittance(linear, solid):
    """Sun and sky come down through clear air here, so that T is that of the way to the eye: median within 2 %."""
    depth, known = solid
    extinction = np.add(*read_fog(linear).coefficients())
    truth = np.exp(-depth[known][:, None] * extinction)
    error = np.abs(read_map(linear.transmittance)[known] / truth - 1)
    assert np.median(error) < 0.01
    assert np.percentile(error, 90) < 0.10


def test_open_sky_is_all_fog(linear, solid):
    """At the depth of the sky, 75 optical depths away, V is the airlight, and the sky's own light is gone."""
    sky = ~solid[1]
    sky[250:] = False
    transmittance, v = read_map(linear.transmittance), read_map(linear.in_scattering())
    inner = sky & (np.abs(np.arange(560) - 280) < 60)
    assert transmittance[inner].max() < 1e-4
    # from row to row and column to column no step: the airlight of neighbouring rays is the same within 2 %
    column = v[:250, 270:290].mean(1)
    assert (np.abs(np.diff(column, axis=0)) < 0.02 * column[1:]).all()
