"""`match` from files to files: an open-air view in known fog, its scene file, what is refused, and make."""

from __future__ import annotations

import shutil

import cv2
import imagecodecs
import numpy as np
import pytest

from pipeline.cli import main
from pipeline.imaging.colour import linear_to_srgb
from pipeline.imaging.maps import read_map, write_map
from pipeline.paths import Build
from pipeline.scene.artefacts import read_json
from pipeline.scene.load import load_scene
from tests.conftest import CHAIN
from tests.test_bad_input import refusal
from tests.test_daylight import OPEN_AIR, picture
from tests.test_make import PROJECT, Made, refused
from tests.validation.truth import Fog, Truth

VISIBILITY = 75.0
ALBEDO = [0.95, 0.93, 0.9]


@pytest.fixture
def view(tiny_scene):
    """A street without shadows in the fog, whose V has closed forms: its chain renders nothing."""
    tiny_scene.file.write_text(OPEN_AIR.replace("{type: sunlight, ", "{type: sunlight, shadows: false, "))
    write_map(tiny_scene.folder / "photograph.exr", picture())
    return tiny_scene


@pytest.fixture
def foggy(view):
    """The view, and beside its photograph two of it in fog: linear, and as a camera gives it, a stop darker and bluish."""
    fog = (f"fog.visibility={VISIBILITY}", f"fog.single_scattering_albedo={ALBEDO}")
    assert view.run(*CHAIN, overrides=fog) == 0
    linear = read_map(view.build.foggy(".exr"))
    write_map(view.folder / "foggy.exr", linear)
    codes = np.round(255 * np.clip(linear_to_srgb(0.5 * linear * np.float32([0.95, 1, 1.1])), 0, 1)).astype(np.uint8)
    (view.folder / "foggy.jpg").write_bytes(imagecodecs.jpeg8_encode(codes, level=92))
    assert view.run("resolve") == 0
    return view


def matched(scene, *arguments, name="tiny"):
    return main(["match", "--scene", name, "--scenes", str(scene.root / "scenes"), "--build", str(scene.root / "build"), *arguments])


def test_fog_of_a_photograph(foggy, capsys):
    before = foggy.file.read_text()
    capsys.readouterr()
    assert matched(foggy, "--reference", "foggy.exr") == 0
    said = capsys.readouterr()
    facts = read_json(foggy.build.match / "match.json")
    assert facts["visibility_m"]["value"] == pytest.approx(VISIBILITY, rel=0.01)
    low, high = facts["visibility_m"]["interval_95"]
    assert low < VISIBILITY < high and high / low < 1.05
    assert facts["single_scattering_albedo"]["value"] == pytest.approx(ALBEDO, abs=0.02)
    assert facts["exposure_ev"]["value"] == pytest.approx(0, abs=0.02) and facts["unexplained_share"] < 0.01
    fog = load_scene(foggy.file, fog="matched").fog
    assert fog.visibility == pytest.approx(VISIBILITY, rel=0.01) and foggy.file.read_text().startswith(before)
    assert "make scene=tiny fog=matched" in said.out and "fog of " in said.err
    for name in ("comparison.png", "residual.png"):
        assert cv2.imread(str(foggy.build.match / name)) is not None
    # the residual is grey but for noise of rounding
    residual = cv2.imread(str(foggy.build.match / "residual.png")).astype(int)
    assert np.median(np.abs(residual - 128)) <= 5
    assert not (foggy.build.shared / "trials" / "default").exists() or not list((foggy.build.shared / "trials" / "default").rglob("*.exr"))

    # a camera's picture of it: nothing is tried anew, and the entry of before is replaced
    assert matched(foggy, "--reference", "foggy.jpg") == 0
    said, facts = capsys.readouterr(), read_json(foggy.build.match / "match.json")
    assert "fog of " not in said.err
    assert facts["visibility_m"]["value"] == pytest.approx(VISIBILITY, rel=0.03)
    assert facts["exposure_ev"]["value"] == pytest.approx(np.log2(0.5 * (0.95 * 1.1) ** (1 / 3)), abs=0.05)
    assert foggy.file.read_text().count("matched:") == 1 and "of foggy.jpg" in foggy.file.read_text()

    # the fog of this view for another scene, where it is this one's only
    shutil.copytree(foggy.folder, foggy.root / "scenes" / "other")
    other = foggy.root / "scenes" / "other" / "scene.yaml"
    other.write_text(before)
    assert matched(foggy, "--reference-scene", "tiny", "--reference", "foggy.jpg", "--to", "as_there", name="other") == 0
    assert load_scene(other, fog="as_there").fog.visibility == pytest.approx(VISIBILITY, rel=0.03)
    assert "of foggy.jpg in tiny" in other.read_text() and "as_there" not in foggy.file.read_text()
    facts = read_json(Build("other", None, foggy.root / "scenes", foggy.root / "build").match / "match.json")
    assert (facts["scene"], facts["reference_scene"]) == ("other", "tiny")

    # the clear photograph itself: nothing is written
    before = foggy.file.read_text()
    assert matched(foggy, "--reference", "photograph.exr") == 0
    said, facts = capsys.readouterr(), read_json(foggy.build.match / "match.json")
    assert "visibility not determined" in said.out and "no fog was written" in said.err
    assert facts["fog"] is None and facts["visibility_m"]["value"] is None and facts["visibility_m"]["interval_95"][0] > 1e4
    assert foggy.file.read_text() == before


@pytest.mark.parametrize("arguments, says", [
    (("--reference", ""), "no photograph in fog is named; put it into"),
    (("--reference", "absent.jpg"), "absent.jpg: no such file"),
    (("--reference", "../../secret.jpg"), "'../../secret.jpg' leads out of the scene's folder"),
    (("--reference", "scene.yaml"), "not a readable image"),
    (("--reference", "wide.png"), "96 x 40 pixels, of another shape than the photograph's 96 x 64; crop it"),
    (("--reference", "white.png"), "only 0 of 6144 pixels can be compared"),
    (("--reference", "white.png", "--fit", "visibility,albeo"), "nothing is called 'albeo'; name some of visibility, albedo, gains, g, "
                                                                 "with commas between (did you mean 'albedo'?)"),
    (("--reference", "white.png", "--to", "match"), "to=match is no fog's name"),
    (("--reference", "white.png", "--to", "mine"), "a fog is called 'mine' already, and not by an earlier match; give another name"),
    (("--reference", "white.png", "--reference-scene", "absent"), "no such file"),
])
def test_mistakes_are_said_before_anything_is_tried(arguments, says, view, capsys):
    view.file.write_text(view.file.read_text() + "fogs:\n  mine: {type: homogeneous, visibility: 20}\n")
    (view.folder / "wide.png").write_bytes(imagecodecs.png_encode(np.zeros((40, 96, 3), np.uint8)))
    (view.folder / "white.png").write_bytes(imagecodecs.png_encode(np.full((64, 96, 3), 255, np.uint8)))
    assert view.run(*CHAIN[:6]) == 0
    capsys.readouterr()
    before = view.file.read_bytes()
    assert says in refusal(matched(view, *arguments), capsys.readouterr().err, view.root)
    assert view.file.read_bytes() == before and not view.build.match.exists()


def test_clear_fog_leaves_no_light_to_begin_with(view, capsys):
    view.replace("visibility: 100", "visibility: .inf")
    assert view.run(*CHAIN[:6]) == 0
    capsys.readouterr()
    message = refusal(matched(view, "--reference", "photograph.exr"), capsys.readouterr().err, view.root)
    assert "the fog is clear, so that no light was estimated; pick a denser fog to begin with: fog=NAME" in message


@pytest.mark.slow
@pytest.mark.parametrize("fog", [Fog(0.05, 0.1), Fog(0.05, 0.3)], ids=lambda fog: fog.name)
def test_fog_of_a_picture_by_quadrature(fog, tiny_scene):
    """The Cornell room clear and foggy by integrals that share nothing with the pipeline, the latter 8 bit and a stop darker."""
    truth = Truth(48)
    shutil.copy(PROJECT / "scenes" / "cornell" / "scene.yaml", tiny_scene.file)
    (tiny_scene.folder / "photograph.png").unlink()
    write_map(tiny_scene.folder / "photograph.exr", truth.clear)
    codes = np.round(255 * np.clip(linear_to_srgb((0.5 * truth.foggy(fog)).astype(np.float32)), 0, 1)).astype(np.uint8)
    (tiny_scene.folder / "foggy.png").write_bytes(imagecodecs.png_encode(codes))
    assert tiny_scene.run(*CHAIN[:6]) == 0
    assert matched(tiny_scene, "--reference", "foggy.png", "--fit", "visibility,albedo") == 0
    facts = read_json(tiny_scene.build.match / "match.json")
    # T and V are within 1 % of the quadrature's; a room of some metres spans little optical depth, and so trebles that
    extinction = fog.absorption + fog.scattering
    assert facts["extinction_coefficient_per_m"]["value"] == pytest.approx(extinction, rel=0.04)
    assert facts["single_scattering_albedo"]["value"] == pytest.approx(3 * [fog.scattering / extinction], rel=0.05)
    assert facts["exposure_ev"]["value"] == pytest.approx(-1, abs=0.05)


# ---- make --------------------------------------------------------------------------------------

@pytest.mark.slow
def test_make_match(foggy):
    made = Made(foggy.root)
    shutil.rmtree(made.root / "build")
    said = made.made("match", "reference=foggy.jpg", "to=as_seen", "fit=visibility,albedo")
    assert "illumination: " in said and load_scene(foggy.file, fog="as_seen").fog.visibility == pytest.approx(VISIBILITY, rel=0.03)
    again = made.made("match", "reference=foggy.jpg", "to=as_seen", "fit=visibility,albedo")
    assert "fog of " not in again and "illumination: " not in again
    assert "make scene=tiny fog=as_seen" in made.make("scene=tiny", "match", "reference=foggy.jpg", "to=as_seen").stdout
    assert made.make("scene=tiny", "fog=as_seen").returncode == 0


@pytest.mark.parametrize("arguments, says", [
    (("match",), "no scene is named: make match scene=bathroom"),
    (("match", "scene=tiny"), "no photograph in fog is named: make match scene=tiny reference=foggy.jpg"),
    (("scene=tiny", "reference=foggy.jpg"), "reference= is for a match: make match scene=tiny reference=foggy.jpg"),
    (("scene=tiny", "fit=g"), "fit= is for a match"),
    (("match", "scene=tiny", "reference=a.jpg", "reference_scene=../x"), "reference_scene name '../x': use letters"),
    (("match", "scene=tiny", "reference=a.jpg", "reference_scene=$(shell touch x)"), "reference_scene name '$(shell touch x)': use"),
    (("match", "scene=tiny", "reference=a.jpg", "to=$(shell touch x)"), "to name '$(shell touch x)': use letters"),
])
def test_make_refuses(arguments, says, view):
    assert says in refused(Made(view.root).make(*arguments))


def test_a_references_name_is_only_a_name(view):
    """It goes by the environment: neither Make nor a shell reads it."""
    made, name = Made(view.root), "$(shell touch x)`touch x`'; touch x #.jpg"
    result = made.make("match", "scene=tiny", f"reference={name}")
    assert result.returncode == 2 and f"{name}: no such file" in result.stderr
    assert not (PROJECT / "x").exists()
