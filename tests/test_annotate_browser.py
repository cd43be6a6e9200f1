"""The annotation page in a real browser: scenes drawn from nothing by mouse and keys, touch, two tabs, an editor beside it, a kill.

Needs Playwright, Chromium and Bokeh (`make test-browser` installs them and runs this). The real photographs are those that `make
photos` fetches; a scene whose photograph is not there is left out, and one that we made stands beside each.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from ruamel.yaml import YAML

from pipeline.geometry.regions import polygon_mask
from pipeline.imaging.maps import read_map
from pipeline.paths import Build
from tests.annotate_by_hand import draw_open_air, draw_room
from tests.annotate_fixture import scenes_with
from tests.annotate_person import NARROW, PATIENCE, PROJECT, Person, Served
from tests.in_browser import browser, needs_chromium

pytest.importorskip("bokeh", reason="no Bokeh: make test-browser installs it and runs these tests")
pytestmark = needs_chromium


@pytest.fixture
def serve(tmp_path):
    """Starts servers and ends them."""
    running = []

    def one(scenes: Path, scene: str, photo: Path | None = None) -> Served:
        running.append(Served(scenes, tmp_path / "build", scene, photo))
        return running[-1]

    yield one
    for served in running:
        served.end()


@pytest.fixture
def visit(browser):
    people = []

    def one(served: Served, **options) -> Person:
        people.append(Person(browser, served, **options).come())
        return people[-1]

    yield one
    for person in people:
        person.leave()


def photograph(name: str) -> Path:
    for file in ("fetched/photograph.exr", "photograph.jpg"):
        if (path := PROJECT / "scenes" / name / file).exists():
            return path
    pytest.skip(f"no photograph of {name}: make photos fetches it")


def by_hand(name: str) -> dict:
    return YAML(typ="safe").load((PROJECT / "scenes" / name / "scene.yaml").read_text(encoding="utf-8"))


def rendered(scenes: Path, builds: Path, scene: str) -> Build:
    subprocess.run([sys.executable, "-m", "pipeline", "run", "--scene", scene, "--scenes", str(scenes), "--build", str(builds)],
                   cwd=PROJECT, check=True)
    return Build(scene, None, scenes, builds)


def differences(ours: Build, theirs: Build) -> dict[str, float]:
    """Of what was drawn in the page from what was written by hand: focal length [share], sun [degree], T and V [RMS over the mean]."""
    def json_of(path):
        return json.loads(path.read_text())
    found = {"focal_length": json_of(ours.camera)["focal_length_pixel"] / json_of(theirs.camera)["focal_length_pixel"] - 1}
    suns = [json_of(one.sun_direction)["suns"] if one.sun_direction.exists() else {} for one in (ours, theirs)]
    for name in suns[1]:
        a, b = (np.array(one[name]["sun_direction"]) for one in suns)
        found["sun_degree"] = float(np.degrees(np.arccos(np.clip(a @ b, -1, 1))))
    for name in ("transmittance", "in_scattering"):
        a, b = (read_map(getattr(one, name) if name == "transmittance" else one.in_scattering()).astype(float) for one in (ours, theirs))
        found[name] = float(np.sqrt(np.mean((a - b) ** 2)) / np.mean(b))
    return found


@pytest.mark.parametrize("name", ["sunroom", "street", "bathroom"])
def test_a_scene_drawn_from_nothing_renders_like_the_one_written_by_hand(name, serve, visit, tmp_path):
    """Clicks fall on tenths of a pixel: a tenth off in the ends of lines moves the focal length by less than 1 %."""
    served = serve(tmp_path / "scenes", "mine", photograph(name))
    person, hand = visit(served), by_hand(name)
    (draw_open_air if "depth" in hand else draw_room)(person, hand)
    person.page.click('[data-do="render"]')
    person.until("() => document.querySelector('#job').textContent.includes('rendered in')", 20 * PATIENCE)
    person.page.click('[data-do="view"][data-value="result"]')
    person.until("() => window.annotate.shown.url.includes('/result/')")
    theirs = tmp_path / "theirs"
    shutil.copytree(PROJECT / "scenes" / name, theirs / name, ignore=shutil.ignore_patterns("shown", "model", "truth"))
    found = differences(Build("mine", None, served.scenes, served.builds), rendered(theirs, tmp_path / "build", name))
    print(name, {key: round(value, 5) for key, value in found.items()})
    assert abs(found["focal_length"]) < 0.01 and found.get("sun_degree", 0) < 0.5
    assert found["transmittance"] < 0.02 and found["in_scattering"] < 0.05


def test_what_is_drawn_is_seen_at_once_and_saved_with_the_comments(serve, visit, tmp_path):
    served = serve(scenes_with(tmp_path, "bathroom"), "bathroom")
    before = served.path.read_text()
    person = visit(served)
    person.until("() => document.querySelector('.facts').innerText.includes('focal length')")
    facts = person.page.inner_text(".facts")
    assert "focal length" in facts and "field of view" in facts
    person.add("line_x", by="x")
    person.click((194, 330), (323, 300))  # not an edge that runs so: the camera changes
    person.until(f"() => document.querySelector('.facts').innerText !== {json.dumps(facts)}")
    person.saved(lambda data: len(data["camera"]["lines"]["x"]) == 5)
    comments = [line.partition("#")[2] for line in before.splitlines() if "#" in line]
    assert all(one in served.path.read_text() for one in comments)
    person.keys("Escape", "Control+z")
    person.saved(lambda data: len(data["camera"]["lines"]["x"]) == 4)
    assert served.path.read_text() == before, "undone is as it was, byte for byte"


def test_points_by_mouse_and_by_keys(serve, visit, tmp_path):
    served = serve(scenes_with(tmp_path, "bathroom"), "bathroom")
    person = visit(served)
    person.choose("mirror_lamp")
    at = served.data()["lights"]["mirror_lamp"]["outline"]["pixels"]
    person.until("() => Bokeh.documents[0].get_model_by_name('handles').data.x.length === 4")
    person.drag(at[0], (at[0][0] - 12, at[0][1] + 6))
    moved = person.saved(lambda data: data["lights"]["mirror_lamp"]["outline"]["pixels"][0] != at[0])["lights"]["mirror_lamp"]["outline"]["pixels"]
    assert np.allclose(moved[0], [at[0][0] - 12, at[0][1] + 6], atol=0.6) and moved[1:] == at[1:]
    person.page.focus("#stage")
    person.until("() => Bokeh.documents[0].get_model_by_name('handles').selected.indices[0] === 0")
    person.keys("ArrowRight", "ArrowRight", "Shift+ArrowDown")
    again = person.saved(lambda data: data["lights"]["mirror_lamp"]["outline"]["pixels"][0][1] > moved[0][1] + 9)["lights"]["mirror_lamp"]["outline"]["pixels"]
    assert np.allclose(again[0], [moved[0][0] + 2, moved[0][1] + 10], atol=0.11)
    person.keys("i")
    person.saved(lambda data: len(data["lights"]["mirror_lamp"]["outline"]["pixels"]) == 5)
    person.keys("Delete")
    person.saved(lambda data: len(data["lights"]["mirror_lamp"]["outline"]["pixels"]) == 4)


def test_drawn_by_keys_alone(serve, visit, tmp_path):
    served = serve(scenes_with(tmp_path, "bathroom"), "bathroom")
    person = visit(served)
    person.page.focus("#stage")
    person.keys("k", "n", "n", "n")
    person.until("() => Bokeh.documents[0].get_model_by_name('handles').data.x.length === 3")
    person.keys("]", "Shift+ArrowUp", "Shift+ArrowUp", "Enter")
    drawn = person.saved(lambda data: len(data["illumination"]["albedos"]) == 3)["illumination"]["albedos"][2]["pixels"]
    assert len(drawn) == 3 and drawn[0][1] == pytest.approx(drawn[1][1] - 20, abs=0.2)


def test_a_region_is_painted(serve, visit, tmp_path):
    served = serve(scenes_with(tmp_path, "building"), "building")
    person = visit(served)
    person.add("ground", by="g")
    person.keys("q")
    person.until("() => document.querySelector('#stage').classList.contains('brushing')")
    view = person.where(0, 0)
    person.drag((100, 600), (400, 600))
    first = person.saved(lambda data: data["depth"]["regions"]["ground"]["pixels"])["depth"]["regions"]["ground"]
    covered = polygon_mask((700, 560), np.asarray(first["pixels"]))
    assert first["class"] == "support" and covered[600, 105:395].all() and not covered[560].any()
    assert person.where(0, 0) == view, "the view stays where it is"
    # with a wider brush; Bokeh saw none of it as clicks or drags of its own
    person.keys("]", "]", "]", "]")
    person.drag((250, 590), (250, 500))
    wider = person.saved(lambda data: data["depth"]["regions"]["ground"]["pixels"] != first["pixels"])["depth"]["regions"]["ground"]
    thick, thin = (polygon_mask((700, 560), np.asarray(one["pixels"])) for one in (wider, first))
    assert thick[530].sum() > 1.5 * thin[:, 250].sum() and (thick & thin).sum() >= 0.98 * thin.sum()
    person.page.click('[data-do="brush"][data-value="erase"]')
    person.until("() => Bokeh.documents[0].get_model_by_name('wire').brush === 'erase'")
    person.keys("[", "[", "[", "[", "[")
    person.drag((200, 600), (202, 600))
    person.saved(lambda data: data["depth"]["regions"]["ground"].get("holes") or
                 data["depth"]["regions"]["ground"]["pixels"] != wider["pixels"])
    person.keys("Control+z", "Control+z")
    person.saved(lambda data: data["depth"]["regions"]["ground"] == first)
    person.keys("Escape")
    person.until("() => Bokeh.documents[0].get_model_by_name('handles').data.x.length > 3")
    person.until("() => !document.querySelector('.busy')")


def test_the_wheel_zooms_and_a_drag_beside_points_moves_the_view(serve, visit, tmp_path):
    served = serve(scenes_with(tmp_path, "bathroom"), "bathroom")
    person = visit(served)
    before = served.path.read_text()
    centre = person.where(256, 256)
    far = np.subtract(person.where(356, 256), centre)[0]
    person.page.mouse.move(*centre)
    person.page.mouse.wheel(0, -240)
    person.until(f"() => window.annotate.where(356, 256)[0] - window.annotate.where(256, 256)[0] > {far * 1.3}")
    assert np.allclose(person.where(256, 256), centre, atol=3), "about the pointer"
    person.drag((256, 256), (300, 256))
    person.until(f"() => window.annotate.where(256, 256)[0] > {centre[0] + 40}")
    person.keys("0")
    person.until(f"() => Math.abs(window.annotate.where(256, 256)[0] - {centre[0]}) < 2")
    assert served.path.read_text() == before


def test_the_fog_follows_a_slider_and_a_change(serve, visit, tmp_path):
    served = serve(scenes_with(tmp_path, "bathroom"), "bathroom")
    person = visit(served)
    person.until("() => window.annotate.shown.url.includes('/fog/')")
    count = person.page.evaluate("window.annotate.shown.count")
    person.page.focus('[data-slide="visibility"]')
    person.keys("ArrowRight", "ArrowRight")
    person.until(f"() => window.annotate.shown.count > {count}")
    person.saved(lambda data: data["fog"]["visibility"] != 12)
    person.until("() => !document.querySelector('.busy')")


def test_a_problem_is_marked_and_leads_to_its_thing(serve, visit, tmp_path):
    served = serve(scenes_with(tmp_path, "bathroom"), "bathroom")
    person = visit(served)
    person.choose("tub")
    corner = served.data()["shapes"]["tub"]["corners"]["front_left_top"]
    person.until("() => Bokeh.documents[0].get_model_by_name('handles').data.x.length === 5")
    person.drag(corner, (corner[0] - 60, corner[1] - 70))
    person.until("() => document.querySelector('#problems li') !== null")
    person.keys("Escape")
    person.page.click("#problems li button")
    person.until("() => document.querySelector('#things .thing.on.bad') !== null")


def test_two_tabs_and_an_editor(serve, visit, tmp_path):
    served = serve(scenes_with(tmp_path, "bathroom"), "bathroom")
    first, second = visit(served), visit(served)
    assert "Another tab" in second.page.inner_text("#banner") and second.page.is_disabled('[data-do="add"][data-kind="box"]')
    served.path.write_text(served.path.read_text().replace("visibility: 12 ", "visibility: 7 "))
    for person in (first, second):
        person.until("() => document.querySelector('#fog output').textContent.startsWith('7')")
    second.page.click('[data-do="pen"]')
    second.until("() => !document.querySelector('[data-do=\"add\"][data-kind=\"box\"]').disabled")
    first.until("() => document.querySelector('#banner').innerText.includes('Another tab')")
    second.page.reload()
    second.until("() => !!(window.annotate && window.annotate.ready) && document.querySelector('#add button') !== null")
    second.until("() => !document.querySelector('#banner').innerText.includes('Another tab')")


def test_killed_the_page_says_so_and_the_file_is_whole(serve, visit, tmp_path):
    served = serve(scenes_with(tmp_path, "bathroom"), "bathroom")
    person = visit(served)
    person.add("line_y", by="y")
    person.click((50, 100), (52, 300))
    person.saved(lambda data: len(data["camera"]["lines"]["y"]) == 3)
    served.kill()
    assert len(served.data()["camera"]["lines"]["y"]) == 3
    person.until("() => document.querySelector('#gone').hidden === false")
    person.faults.clear()  # the browser's own word that nobody answers


def test_on_a_narrow_screen_by_touch(serve, visit, tmp_path):
    served = serve(scenes_with(tmp_path, "bathroom"), "bathroom")
    person = visit(served, viewport=NARROW, has_touch=True, is_mobile=True)
    assert person.page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    person.page.tap('[data-do="add"][data-kind="line_z"]')
    person.until("() => document.querySelector('[data-kind=line_z]').classList.contains('on')")
    person.page.evaluate("scrollTo(0, 0)")
    for point in ((100, 120), (200, 160)):
        person.page.touchscreen.tap(*person.where(*point))
        person.page.wait_for_timeout(350)
    person.saved(lambda data: len(data["camera"]["lines"]["z"]) == 5)


def test_a_large_photograph_keeps_its_own_coordinates(serve, visit, tmp_path):
    """24 megapixels: what is clicked on the reduced copy stands in the file in the photograph's pixels."""
    import cv2
    small = cv2.imread(str(PROJECT / "scenes/bathroom/photograph.jpg"))
    cv2.imwrite(str(tmp_path / "large.jpg"), cv2.resize(small, (6000, 4000)))
    served = serve(tmp_path / "scenes", "large", tmp_path / "large.jpg")
    person = visit(served)
    shown = person.page.evaluate("""async () => { const image = new Image(); image.src = window.annotate.shown.url ||
        location.pathname + 'picture/large/clear'; await image.decode(); return image.width * image.height; }""")
    assert shown <= 1.01e6
    person.add("line_x", by="x")
    person.click((1000, 3000), (5000, 3100))
    line = person.saved(lambda data: data["camera"]["lines"]["x"])["camera"]["lines"]["x"][0]
    assert np.allclose(line, [[1000, 3000], [5000, 3100]], atol=4), "half a screen pixel is 4 of the photograph's"
