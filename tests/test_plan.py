"""The plan: cheapest renders for what is asked, nothing that the scene does not need, and what it knows of its error."""

import json
import re
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from pipeline.cli import main
from pipeline.errors import InputError
from pipeline.geometry.raycast import first_hits
from pipeline.geometry.segments import blocked
from pipeline.imaging.maps import read_map
from pipeline.paths import CALIBRATION, PROJECT
from pipeline.planning import trial
from pipeline.planning.accuracy import error_estimate, relative_error
from pipeline.planning.calibrate import laws
from pipeline.planning.choosing import FINEST, MOST_OF_MAPS, SHOWS, TOLERANCE, choose
from pipeline.planning.demands import EXACT, GLOW, SHAFT, SINGLE, Demands, LightDemand
from pipeline.planning.model import CARRIED, calibration, error_of, errors_of, seconds_of
from pipeline.rendering import own_templates
from pipeline.rendering.emit import Templates
from pipeline.rendering.fineness import AREA, INTEGRATED, MIDPOINT, Fineness, as_json
from pipeline.rendering.pruning import without_unused_macros
from pipeline.scene.artefacts import FOG_STAGES, read_fog, read_json, read_placed
from tests.test_light_transport import DESCRIBED, chain, run

SETTINGS = {"tolerance": None, "budget": None, "quality": "normal"}
CONSTANTS = calibration()


def lamp(**changes) -> LightDemand:
    return replace(LightDemand("lamp", GLOW, 0.4, 25, 5, True, True, {AREA: 0.0, INTEGRATED: 0.01, MIDPOINT: 0.02}, 25),
                   **changes)


def room(*lights: LightDemand) -> Demands:
    return Demands(480, 480, 20, 1, 2.0, 0.6, list(lights or [lamp()]))


def test_a_tighter_tolerance_takes_no_less_time_and_is_met_by_the_model():
    chosen = [choose(room(), {**SETTINGS, "tolerance": one}, CONSTANTS) for one in (0.1, 0.05, 0.02, 0.01, 0.005, 0.002)]
    assert all(one.error <= one.tolerance for one in chosen)
    seconds = [one.seconds for one in chosen]
    assert seconds == sorted(seconds) and seconds[0] < seconds[-1]


@pytest.mark.parametrize("quality", TOLERANCE)
def test_a_quality_is_a_tolerance(quality):
    named = choose(room(), {**SETTINGS, "quality": quality}, CONSTANTS)
    assert named == choose(room(), {**SETTINGS, "tolerance": TOLERANCE[quality]}, CONSTANTS)


def test_more_time_makes_no_more_error_and_no_plan_is_longer_than_its_budget():
    quickest = choose(room(), {**SETTINGS, "tolerance": 1.0}, CONSTANTS).seconds
    chosen = [choose(room(), {**SETTINGS, "budget": quickest * k}, CONSTANTS) for k in (1.01, 1.5, 3, 10)]
    errors = [one.error for one in chosen]
    assert errors == sorted(errors, reverse=True) and errors[-1] < errors[0]
    assert all(one.seconds <= 1.001 * quickest * k for one, k in zip(chosen, (1.01, 1.5, 3, 10)))
    # less than anything takes: the quickest there is
    assert choose(room(), {**SETTINGS, "budget": 0.1}, CONSTANTS).seconds == pytest.approx(quickest, rel=0.01)


def test_what_cannot_be_met_is_as_near_as_may_be():
    chosen = choose(room(), {**SETTINGS, "tolerance": 1e-4}, CONSTANTS)
    assert 1e-4 < chosen.error < 1.1 * error_of(room(), FINEST, CONSTANTS)


def test_a_stated_knob_that_is_too_coarse_makes_no_other_finer_than_it_need_be():
    coarse = choose(room(), {**SETTINGS, "samples": 2}, CONSTANTS)
    assert coarse.error > 0.01 and coarse.seconds < 1.5 * choose(room(), SETTINGS, CONSTANTS).seconds


def test_knobs_that_a_scene_states_hold_and_the_others_make_up_for_them():
    own = {**SETTINGS, "shadow_size": 256, "transmittance": "area"}
    chosen = choose(room(), own, CONSTANTS).fineness
    assert chosen.shadow_size == 256 and chosen.transmittance == AREA
    few = choose(room(), {**SETTINGS, "samples": 2}, CONSTANTS)
    assert few.fineness.samples == 2 and few.fineness.shaft_samples == 6


def test_the_model_says_more_time_and_less_error_for_each_finer_knob():
    both = room(lamp(), lamp(name="sun", work=SHAFT, blurred=False, sub_lights=1, side=1))
    coarse = Fineness(in_scattering_size=48, glow_tolerance=0.1, shadow_size=24, samples=4, shadow_lights=2, shaft_samples=6,
                      transmittance=INTEGRATED)
    for knob, finer in (("in_scattering_size", 96), ("shadow_size", 96), ("samples", 24), ("shadow_lights", 4),
                        ("shaft_samples", 48), ("transmittance", AREA)):
        fine = replace(coarse, **{knob: finer})
        assert seconds_of(both, fine, CONSTANTS) > seconds_of(both, coarse, CONSTANTS), knob
        assert error_of(both, fine, CONSTANTS) < error_of(both, coarse, CONSTANTS), knob
    coarse, fine, reflecting = (*(Fineness(room_directions=count) for count in (32, 128)), replace(both, reflecting=0.6))
    assert seconds_of(reflecting, fine, CONSTANTS) > seconds_of(reflecting, coarse, CONSTANTS)
    assert error_of(reflecting, fine, CONSTANTS) < error_of(reflecting, coarse, CONSTANTS)
    assert error_of(both, fine, CONSTANTS) == error_of(both, coarse, CONSTANTS), "it concerns rooms alone"


def test_the_model_knows_which_render_tells_a_lights_shadows_and_what_stands_round_the_fog():
    def less(light: LightDemand, knob: str) -> bool:
        """Whether this knob's level says what the light is off by."""
        coarse, fine = (error_of(room(light), Fineness(transmittance=AREA, transmittance_size=20000, **{knob: level}), CONSTANTS)
                        for level in (48, 192))
        return fine < coarse

    bulb = lamp(work=SINGLE, blurred=False, sub_lights=1, side=1)
    bulbs, open_sky = replace(bulb, blurred=True, sub_lights=16), lamp(work=EXACT, shadows=False, blurred=False)
    assert less(bulb, "in_scattering_size") and not less(bulb, "shadow_size")
    assert less(bulbs, "shadow_size") and not less(bulbs, "in_scattering_size")
    assert not less(open_sky, "in_scattering_size")
    assert less(replace(open_sky, surrounded=True), "in_scattering_size")


def test_calibration_finds_the_laws_that_measurements_follow():
    """Of glow from cases without anything round the fog; what the others are off by beyond that is what stands round it."""
    def law(factor, exponent, level):
        return factor * level**exponent

    records = []
    for level in (48, 64, 96):
        own = law(100.0, -1.8, level)
        records.append({"case": "open", "knob": "in_scattering_size", "level": level, "added": 0.4 * own, "share": 0.4,
                        "besides": 0.0, "error": own})
        both = np.hypot(0.2 * own, 0.9 * law(30.0, -1.5, level))
        records.append({"case": "room", "knob": "in_scattering_size", "level": level, "added": both, "share": 0.2, "besides": 0.9,
                        "error": None})
    for level in (32, 64):
        records.append({"case": "room", "knob": "room_directions", "level": level, "error": law(2.0, -1.2, level)})
    for way, off in ((INTEGRATED, 0.2), (MIDPOINT, 0.7)):
        records.append({"case": "open", "knob": "half_shadow", "level": way, "error": off})
    found = laws(records)
    assert found["in_scattering_size"] == pytest.approx([100.0, -1.8])
    assert found["surroundings"] == pytest.approx([30.0, -1.5]) and found["room_directions"] == pytest.approx([2.0, -1.2])
    assert found["half_shadow"] == pytest.approx([0.2, 0.7])
    assert set(found) == set(CONSTANTS.error), "all that the model asks for"


def test_no_pixel_that_checks_a_room_lies_where_faces_meet(tmp_path):
    build = chain(tmp_path, {"area": DESCRIBED["area"]}, box=True, render={"checked_pixels": 400})
    face = read_map(build.surfaces)[..., 0]
    rows, columns = np.array(read_json(build.plan)["check"]["pixels"]).T
    assert len(rows) > 100 and len(np.unique(face[rows, columns])) > 4
    padded = np.pad(face, 1, mode="edge")
    for dy, dx in ((0, 1), (2, 1), (1, 0), (1, 2)):
        assert (padded[rows + dy, columns + dx] == face[rows, columns]).all()


@pytest.mark.parametrize("tolerance, of_maps", [(0.05, 0.05), (0.02, 0.02), (0.01, SHOWS), (0.002, MOST_OF_MAPS * 0.002)])
def test_t_and_v_are_held_to_less_than_the_picture(tolerance, of_maps):
    """A V that is small in the picture is not made for nothing, nor left as it comes."""
    faint = room(lamp(share=0.01))
    found = choose(faint, {**SETTINGS, "tolerance": tolerance}, CONSTANTS)
    by = errors_of(faint, found.fineness, CONSTANTS)
    of_v = np.sqrt(sum(value**2 for knob, value in by.items() if knob != "transmittance")) / faint.share()
    assert of_maps / 3 < of_v <= of_maps and by["transmittance"] <= of_maps * faint.surfaces


def test_a_calibration_of_this_machine_outweighs_the_carried_one(tmp_path):
    assert calibration(tmp_path) == calibration()
    stated = json.loads(CARRIED.read_text())
    stated["seconds"]["fixed"] = 123.0
    (tmp_path / CALIBRATION).write_text(json.dumps(stated))
    assert calibration(tmp_path).seconds["fixed"] == 123.0
    (tmp_path / CALIBRATION).write_text("{}")
    with pytest.raises(InputError, match="make calibrate"):
        calibration(tmp_path)


def test_smaller_renders_of_t_are_used_and_near_those_of_the_photographs_size(tmp_path):
    lights, fog = {"area": DESCRIBED["area"]}, {
        "type": "homogeneous", "absorption_coefficient": [0.4] * 3, "scattering_coefficient": [0.1] * 3}
    full, small, none = (chain(tmp_path / name, lights, box=True, fog=fog, render=render) for name, render in (
        ("full", {"transmittance": "area"}), ("small", {"transmittance": "area", "transmittance_size": 24}),
        ("none", {"transmittance": "integrated"})))
    assert read_map(small.runs / "transmittance_area.exr").shape == (18, 24, 3)
    t, other, without = (read_map(one.transmittance) for one in (full, small, none))
    assert not np.array_equal(other, without), "the render has a say"
    assert np.median(np.abs(other / t - 1)) < 1e-3 and np.percentile(np.abs(other / t - 1), 99) < 0.02


# ---- what the error is ------------------------------------------------------------------------

def test_the_error_is_the_worse_of_bright_and_dark():
    true = np.array([[1.0] * 3, [0.1] * 3])
    assert relative_error(true, true) == 0
    bright, dark = true + [[0.1], [0.0]], true + [[0.0], [0.02]]
    assert relative_error(bright, true) == pytest.approx(0.1 / np.sqrt(1.01), rel=1e-6)
    assert relative_error(dark, true) == pytest.approx(0.2 / np.sqrt(2), rel=1e-6)
    assert relative_error(dark, true, np.array([1.0, 0.0])) == 0


def test_an_estimate_bounds_the_error_of_pictures_like_its_pixels():
    random, met = np.random.default_rng(3), 0
    for _ in range(200):
        off = 0.01 * random.standard_normal((64, 3))
        v = np.full((64, 3), 0.5)
        found = error_estimate(np.ones((64, 3)), (v, v * (1 + off)), (v, v), np.ones(64))
        met += found["at_most"] >= 0.005  # of the picture, half of which is V
    assert met >= 180
    shared = error_estimate(np.ones((64, 3)), (v, v), (v, v), np.ones(64), 0.01)
    assert (shared["relative_error"], shared["at_most"], shared["shared"]) == (0.01, 0.01, 0.01)


def test_converged_pixels_tell_the_error_of_the_whole_picture(tmp_path):
    """Coarse maps against the same chain at its finest, at all pixels; and by single pixels alone."""
    lights = {"area": DESCRIBED["area"], "sun": DESCRIBED["sun"]}
    coarse = {"samples": 5, "in_scattering_size": 16, "shadow_size": 16, "shadow_lights": 2, "shaft_samples": 6,
              "glow_tolerance": 0.1, "transmittance": "midpoint"}
    fine = {"samples": 60, "in_scattering_size": 512, "shadow_size": 512, "shadow_lights": 8, "shaft_samples": 200,
            "glow_tolerance": 1e-3, "transmittance": "area", "transmittance_step": 0.02}
    few = chain(tmp_path / "few", lights, box=True, render={**coarse, "checked_pixels": 200})
    many = chain(tmp_path / "many", lights, box=True, render={**fine, "checked_pixels": 200})
    found, finest = (read_map(one.foggy(".exr"))[read_map(one.surfaces)[..., 1] < 0] for one in (few, many))
    true = relative_error(found, finest)
    told = read_json(few.maps)["estimated_error"]
    assert 0.5 * true <= told["relative_error"] <= 2 * true and told["at_most"] >= 0.8 * true, (true, told)
    # the finest itself is near what its pixels are by another way
    assert read_json(many.maps)["estimated_error"]["relative_error"] < 0.15 * true


def test_segments_are_blocked_as_rays_are():
    random = np.random.default_rng(0)
    faces = [np.array([[0, 0, -1], [1, 0, -1], [1, 1, -1], [0.5, 0.3, -1], [0, 1, -1]], float),
             np.array([[-1, -1, -2], [2, -1, -2.5], [2, 2, -2]], float)]
    start, ends = np.array([0.3, 0.4, 1.0]), random.uniform([-1, -1, -4], [2, 2, 0.5], (4000, 3))
    length = np.linalg.norm(ends - start, axis=1)
    nearest = first_hits(start, ((ends - start) / length[:, None])[None], faces)[0][0]
    found = blocked(np.broadcast_to(start, ends.shape), ends, faces)
    assert (found == (nearest < length)).all() and 0.1 < found.mean() < 0.9


# ---- nothing that the scene does not need -------------------------------------------------------

def declared(text: str, word: str) -> int:
    code = "\n".join(line.split("//")[0] for line in text.splitlines())
    return len(re.findall(word, code))


def test_the_simplest_scene_states_nothing_it_does_not_need(tmp_path):
    build = chain(tmp_path, {"point": DESCRIBED["point"]}, box=True)
    files = sorted(build.pov.glob("*.pov"))
    assert [one.name for one in files] == ["shadows_point.pov"], "V as far as shadows go; T has a closed form"
    text = files[0].read_text()
    assert declared(text, "light_source") == 1 and declared(text, r"\bmedia \{") == 1 and declared(text, r"\bcamera \{") == 1
    for block in ("density", "Fog_Sun", "Fog_Spot", "Fog_Cell", "radiosity", "projected_through", "Fog_Extinction",
                  "Fog_Density", "Fog_Phase_Isotropic", "Fog_Rays", "Fog_Albedo"):
        assert declared(text, block) == (block == "Fog_Albedo"), block
    # every macro that is left is called
    for name in re.findall(r"#macro (\w+)", text):
        assert declared(text, rf"\b{name}\b") > 1, name


def test_no_render_at_all_where_all_is_known(tmp_path):
    build = chain(tmp_path, {"point": DESCRIBED["point"], "reflected": {"type": "ambient", "radiance": [0.1] * 3}})
    assert read_json(build.plan)["runs"] == [] and not list(build.pov.glob("*.pov"))
    dark = chain(tmp_path / "dark", {"area": {**DESCRIBED["area"], "radiance": [0, 0, 0]}}, box=True)
    assert read_json(dark.plan)["runs"] == [] and "area: strength 0, no render" in read_json(dark.plan)["reasons"]


def test_pruning_keeps_what_is_called_by_what_is_called():
    text = "\n".join(["// ---- head.inc", "// of A", "#macro A()", "  #if (1) B() #end", "#end", "#macro B()", "#end",
                      "// of C", "#macro C()", "  A()", "#end", "A()"])
    assert without_unused_macros(text).split("\n") == [*text.split("\n")[:7], "", "", "", "", "A()"]


# ---- the plan is data; templates are a person's -------------------------------------------------

def test_an_edited_plan_is_run(tmp_path):
    build = chain(tmp_path, {"area": DESCRIBED["area"]}, box=True)
    before = read_map(build.in_scattering())
    plan = json.loads(build.plan.read_text())
    plan["runs"] = [{**one, "samples": 2, "width": 20, "height": 15} if one["id"] == "shadows_area" else one
                    for one in plan["runs"]]
    plan["fineness"]["in_scattering_size"] = 20
    build.plan.write_text(json.dumps(plan))
    run(build, stages=("emit", "render", "decompose"))
    assert read_map(build.runs / "shadows_area.exr").shape == (15, 20, 3)
    change = np.abs(read_map(build.in_scattering()) / before - 1)
    assert 1e-4 < np.median(change) < 0.2
    plan["fineness"]["colour"] = 1
    build.plan.write_text(json.dumps(plan))
    assert main(["decompose", "--scene", build.scene, "--scenes", str(build.scenes), "--build", str(build.builds)]) == 2


@pytest.mark.parametrize("name", ["media/homogeneous.inc", "transmittance.pov", "lights/point.inc", "fog_scattering.inc"])
def test_an_edited_template_is_rendered_where_it_can_show(tmp_path, monkeypatch, name):
    build = chain(tmp_path, {"point": DESCRIBED["point"]})
    scene, medium = read_placed(build), read_fog(build)
    templates = Templates(build.source)
    assert own_templates.rendered_for_their_templates(templates, scene, medium) == []
    known = own_templates._shipped()
    key = next(one for one in known if one.endswith(f"/{name}"))
    monkeypatch.setattr(own_templates, "_shipped", lambda: {**known, key: "0" * 64})
    assert own_templates.rendered_for_their_templates(templates, scene, medium) == ["point"]


def test_the_digests_are_those_of_the_templates():
    done = subprocess.run(["sha256sum", "--check", "--quiet", "templates/SHA256SUMS"], cwd=PROJECT, capture_output=True)
    assert done.returncode == 0, "run `make digests`"
    assert len(own_templates._shipped()) == sum(
        1 for folder in ("templates", "povray_includes") for one in (PROJECT / folder).rglob("*") if one.suffix in (".inc", ".pov"))


def test_trials_leave_the_scenes_own_results_alone(tmp_path):
    build = chain(tmp_path, {"area": DESCRIBED["area"]}, box=True)
    before = {path: path.read_bytes() for path in build.out.glob("*.exr")}
    build.lines.exists() or build.lines.write_text("{}")
    seconds = trial.run(build, "one", {**as_json(Fineness(in_scattering_size=24, samples=4)), "checked_pixels": 20})
    assert min(seconds.values()) > 0 and set(seconds) == set(FOG_STAGES)
    assert np.isfinite(read_map(trial.of(build, "one").foggy(".exr"))).all()
    assert {path: path.read_bytes() for path in build.out.glob("*.exr")} == before


@pytest.mark.parametrize("said, problem", [
    ({"tolerance": "0.02", "budget": "10s"}, "both say how accurate"), ({"quality": "superb"}, "'draft', 'normal' or 'final'"),
    ({"tolerance": "no"}, "render.tolerance"), ({"budget": "0s"}, "render.budget"), ({"tolerance": "$(shell id)"}, "tolerance name")])
def test_what_make_is_asked_is_checked(said, problem, tmp_path):
    done = subprocess.run(["make", "resolve", "scene=cornell", f"BUILD={tmp_path}", *(f"{k}={v}" for k, v in said.items())],
                          cwd=PROJECT, capture_output=True, text=True)
    assert done.returncode == 2 and problem in done.stderr, done.stderr


@pytest.mark.parametrize("said, found", [
    ("quality=draft", {"quality": "draft", "tolerance": None, "budget": None}),
    ("tolerance=0.03", {"tolerance": 0.03, "budget": None}), ("budget=12s", {"budget": 12.0, "tolerance": None}),
    ("budget=0.5", {"budget": 0.5})])
def test_make_passes_on_what_is_asked(said, found, tmp_path):
    done = subprocess.run(["make", "resolve", "scene=cornell", f"BUILD={tmp_path}", said], cwd=PROJECT, capture_output=True,
                          text=True)
    assert done.returncode == 0, done.stderr
    settings = json.loads((tmp_path / "cornell" / "inputs" / "render.json").read_text())
    assert {key: settings[key] for key in found} == found
