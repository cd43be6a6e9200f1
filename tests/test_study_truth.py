"""Truths that stimuli are held against: the scripts that render them, and the files that the project carries."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.imaging.maps import read_map
from pipeline.paths import PROJECT
from pipeline.plugins.phase_functions.henyey_greenstein import HenyeyGreenstein
from tests.reference import path_tracer
from tests.validation.truth import ROOM, Truth

SCENES = PROJECT / "scenes"
#: Those that are there; tests/test_study.py sees to it that the carried study has all of its.
BUILDING, CORNELL = (sorted(path.stem for path in (SCENES / scene / "truth").glob("*.exr")) for scene in ("building", "cornell"))


def script(scene: str):
    """scenes/SCENE/model/foggy.py as a module; what it puts before everybody's path is taken away again."""
    path, modules = list(sys.path), set(sys.modules)
    spec = importlib.util.spec_from_file_location(f"{scene}_foggy", SCENES / scene / "model" / "foggy.py")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    finally:
        sys.path[:] = path
        for name in set(sys.modules) - modules:
            # of one name in several scenes
            if name in ("render", "modelled", "in_fog"):
                del sys.modules[name]
    return module


@pytest.fixture(scope="module")
def street():
    return script("building")


@pytest.fixture(scope="module")
def room():
    return script("cornell")


# ---- building's script ------------------------------------------------------------------------

def test_fog_without_shade_is_the_closed_form(street):
    """The highest rows of the picture see sky that nothing shades: V = p E (1 - exp(-kappa reach)), at 56x70 pixels.

    POV-Ray integrates by 128 midpoints, whose error there is (kappa step)^2 / 24 < 1e-4; half floats keep 5e-4.
    """
    kappa = 0.0374
    ratio, distance = street.scattered(56, 70, kappa, Scattering=kappa, Extinction=kappa, Asymmetry=0.7, Reach=street.REACH)
    numbers = street.modelled.numbers(street.MODEL / "numbers.inc")
    to_eye = -street.directions(street.camera(numbers).directions, 70, 56)
    travel = np.array(street.truth(numbers)["sun"]["direction"])
    free = street.phase(to_eye @ travel, 0.7)
    rows = (slice(0, 3), slice(20, 36))
    assert (distance[rows] == street.SKY).all()
    assert ratio[rows] / free[rows] == pytest.approx(1, abs=2e-3)
    # and the street itself, between its houses, lies in shade in part
    assert (ratio / free).min() < 0.8 and (ratio / free).max() < 1.01


@pytest.mark.parametrize("asymmetry", [0.0, 0.3, 0.7])
def test_light_from_above_and_below_is_all_of_it(street, asymmetry):
    """Of uniform light the phase function leaves nothing out: level rays see half of it above them."""
    across = np.stack([np.ones((24, 24)), np.zeros((24, 24)), np.zeros((24, 24))], -1)
    above, below, listed = street.halves(across, asymmetry)
    assert above + below == pytest.approx(1) and above == pytest.approx(0.5, abs=2e-3)
    # 64 directions of a forward lobe of half width 20 degrees; their ratio is what foggy.py corrects by
    assert listed == pytest.approx(0.5, abs=0.03)
    up = np.roll(across, 1, -1)
    exact, _, _ = street.halves(up, asymmetry)
    cosine = np.linspace(0, 1, 2001)
    # light from above travels down, against a ray whose way to the eye is up
    wanted = 2 * np.pi * np.trapezoid(street.phase(-cosine, asymmetry), cosine)
    assert exact == pytest.approx(wanted, rel=2e-3)


def test_its_phase_function_is_the_pipelines(street):
    """Written anew there, so that a truth shares nothing with what it judges; a sign would be seen here."""
    cosine = np.linspace(-1, 1, 11)
    assert street.phase(cosine, 0.7) == pytest.approx(HenyeyGreenstein(type="henyey_greenstein", asymmetry=0.7).value(cosine))


def test_enlarging_keeps_a_constant_and_an_edge_of_depth(street):
    coarse, fine = np.repeat([[5.0, 40.0]], 8, 0).repeat(4, 1), np.repeat([[5.0, 40.0]], 24, 0).repeat(12, 1)
    assert street.enlarged(np.full((8, 8), 0.3), coarse, fine) == pytest.approx(0.3)
    # 1 near and 2 far: behind the same edge, nothing in between
    assert street.enlarged(np.where(coarse < 10, 1.0, 2.0), coarse, fine) == pytest.approx(np.where(fine < 10, 1.0, 2.0), abs=1e-4)


def test_fog_that_is_uneven_or_coloured_is_refused(street, tmp_path):
    text = (SCENES / "building/scene.yaml").read_text()
    (tmp_path / "scene.yaml").write_text(text + "  blue: {type: homogeneous, visibility: 40, single_scattering_albedo: [0.8, 0.9, 1]}\n")
    with pytest.raises(InputError, match="fog 'blue' is not grey"):
        street.in_fog.fog(tmp_path, "blue")
    with pytest.raises(InputError, match="fog 'banks' is noise.*homogeneous fogs"):
        street.in_fog.fog(SCENES / "building", "banks")
    with pytest.raises(InputError, match="no fog is called 'thik'.*did you mean 'thick'"):
        street.in_fog.fog(SCENES / "building", "thik")


# ---- building's files -------------------------------------------------------------------------

@pytest.mark.parametrize("name", BUILDING)
def test_asphalts_grain_fades_with_its_distance(street, name):
    """Before the camera's feet fog adds a smooth veil, and leaves exp(-kappa d) of the grain: known by the true depth.

    The slope of the grain in fog against that in clear air, after a blur of 8 pixels is taken off both, over three bands
    of ground in the sun. 3 %: rows of a band differ in distance by 20 %, and the veil is not quite smooth.
    """
    fog = street.in_fog.fog(SCENES / "building", name)
    clear = read_map(SCENES / "building/photograph.exr")
    foggy = read_map(SCENES / "building/truth" / f"{name}.exr")
    depth = read_map(SCENES / "building/true_depth.exr").reshape(clear.shape[:2])
    grain = [one - cv2.GaussianBlur(one, (0, 0), 8) for one in (clear, foggy)]
    for rows in (slice(600, 620), slice(640, 660), slice(670, 690)):
        band = (rows, slice(300, 430))
        slope = (grain[0][band] * grain[1][band]).sum((0, 1)) / (grain[0][band] ** 2).sum((0, 1))
        assert slope == pytest.approx(np.exp(-fog.extinction * np.median(depth[band])), rel=0.03)


def test_denser_fog_hides_more():
    """The end house's outline against the sky, 64 m away: its contrast falls from fog to fog."""
    contrasts = []
    for name in ("moderate", "default", "thick"):  # 300, 80 and 40 m
        picture = read_map(SCENES / "building/truth" / f"{name}.exr").mean(-1)
        contrasts.append(abs(picture[300:310, 180:300].mean() - picture[325:335, 180:300].mean()))
    assert np.all(np.diff(contrasts) < 0) and contrasts[-1] < 0.1 * contrasts[0]


# ---- cornell ----------------------------------------------------------------------------------

@pytest.mark.parametrize("name", CORNELL)
def test_cornells_truth_is_what_is_traced_anew(room, name):
    """At 16x16 points by other seeds, 4 times 64 paths: their mean within 4 standard errors, the median point within 3, or 1 %.

    1 % is what smoothing within faces moves between neighbours, with the loss of the file (below 0.5 %).
    """
    fog = room.in_fog.fog(SCENES / "cornell", name)
    stored = read_map(SCENES / "cornell/truth" / f"{name}.exr").astype(float)
    coarse = Truth(16)
    # the points lie on corners of the file's pixels
    ours = cv2.blur(stored, (2, 2), anchor=(1, 1))[8::16, 8::16]
    own = path_tracer.Fog(*(float(np.mean(one)) for one in (fog.absorption, fog.scattering)), fog.asymmetry)
    direct = coarse._picture(own.medium())
    pictures = np.array([direct + coarse._shaped(path_tracer.trace(ROOM, coarse.rays, own, 64, seed)[1:].sum(0))
                         for seed in (101, 102, 103, 104)])
    away = ~coarse.rays.emitter.reshape(16, 16)
    theirs, ours = pictures[:, away], ours[away]
    means = theirs.mean(1)
    assert (np.abs(ours.mean(0) - means.mean(0)) < 4 * means.std(0, ddof=1) / 2 + 0.01 * means.mean(0)).all()
    noise = np.median(theirs.std(0, ddof=1) / 2 / theirs.mean(0))
    assert np.median(np.abs(ours / theirs.mean(0) - 1)) < 3 * noise + 0.01


def test_smoothing_stays_within_a_face(room):
    face = np.repeat([[0, 1]], 8, 0).repeat(8, 1)
    values = np.where(face[..., None] == 0, 1.0, 5.0) * np.ones(3)
    assert room.smoothed(values, face, 3.0) == pytest.approx(values)
