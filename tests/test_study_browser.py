"""The study's page in a real browser, used as people do: by keys, by touch, with reloads, in a hidden tab, and too late.

Needs Playwright and Chromium (`make setup-browser`; `make test-browser` runs these tests with them). The clock is Playwright's
where seconds must pass, so that no test waits for them.
"""

from __future__ import annotations

import json
import re
from collections import Counter

import numpy as np
import pytest

from pipeline.cli import main
from pipeline.study.answers import read_answers
from pipeline.study.page import write_page
from tests.in_browser import browser, needs_chromium
from tests.study_fixture import STUDY, made, noise

pytestmark = needs_chromium

PHONE, DESKTOP = {"width": 360, "height": 740}, {"width": 1920, "height": 1080}


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    root = tmp_path_factory.mktemp("page")
    study = made(root)
    write_page(study, noise(study, (300, 400)))
    return study


class Visitor:
    """A person before the page; nothing may go wrong there, and nothing may be fetched."""

    def __init__(self, browser, study, **options):
        self.study, self.faults, self.fetched, self.frozen = study, [], [], False
        self.context = browser.new_context(**{"viewport": DESKTOP, "accept_downloads": True, **options})
        self.page = self.context.new_page()
        self.listen(self.page)

    def listen(self, page):
        page.on("console", lambda message: self.faults.append(message.text))
        page.on("pageerror", lambda error: self.faults.append(str(error)))
        page.on("request", lambda request: self.fetched.append(request.url))

    def freeze(self):
        """Its clock stands still from now on, but for `pass_by`."""
        self.page.clock.install(time=0)
        self.frozen = True
        return self

    def pass_by(self, milliseconds: int) -> None:
        self.page.clock.run_for(milliseconds)

    def come(self):
        self.page.goto(self.study.page.resolve().as_uri())
        if self.frozen:
            self.page.clock.pause_at(1000 * 3600)
        return self

    def screen(self) -> str:
        return self.page.evaluate("document.querySelector('main:not([hidden])').id")

    def ready(self) -> None:
        """Until the pictures are there and the time runs."""
        self.page.wait_for_selector("#pick_a:not([disabled])")
        for _ in range(600):
            # Playwright's own waiting evaluates text, which the page's policy forbids
            if self.page.evaluate("document.getElementById('bar').style.transform !== 'scaleX(1)'"):
                return
            self.pass_by(20) if self.frozen else self.page.wait_for_timeout(50)
        raise AssertionError("the time does not run")

    def kept(self) -> dict:
        """What the page has stored so far."""
        return json.loads(self.page.evaluate("Object.values(localStorage)[0]"))

    def saved(self, folder):
        with self.page.expect_download() as download:
            self.page.click("#save")
        path = folder / download.value.suggested_filename
        folder.mkdir(exist_ok=True)
        download.value.save_as(path)
        return path

    def through(self, key: str = "a") -> None:
        """All trials by keys, from wherever the page is."""
        for _ in range(3 * len(self.study.stimuli)):
            if self.screen() == "end":
                return
            self.page.keyboard.press(" ")
            if self.screen() == "trial":
                self.ready()
                self.page.keyboard.press(key)
        assert self.screen() == "end"

    def leave(self) -> None:
        local = [url for url in self.fetched if not url.startswith(("file:", "data:", "blob:"))]
        self.context.close()
        assert not self.faults and not local, (self.faults, local)


@pytest.fixture
def visit(browser, study):
    visitors = []

    def one(**options) -> Visitor:
        visitors.append(Visitor(browser, study, **options))
        return visitors[-1]

    yield one
    for visitor in visitors:
        visitor.leave()


def test_whole_run_by_keys_to_results(visit, study, tmp_path):
    person = visit().come()
    assert person.screen() == "welcome"
    person.page.keyboard.press(" ")
    assert "Practice 1 of 1" in person.page.inner_text("#progress")
    keys = iter(["a", "ArrowRight", "B", "ArrowLeft"])
    while person.screen() == "ready":
        person.page.keyboard.press(" ")
        person.ready()
        person.page.keyboard.press(next(keys))
    assert person.screen() == "end"
    path = person.saved(tmp_path / "answers")
    one = read_answers(path, study)
    assert path.name == f"answers-{one.participant}.json"
    assert [trial.answer for trial in one.trials] == ["A", "B", "B", "A"] and one.trials[0].practice
    assert all(0 < trial.milliseconds < 15000 and not trial.timed_out and trial.reloads == 0 for trial in one.trials)
    assert all(trial.viewport == [1920, 1080] and trial.shown[0] > 300 for trial in one.trials)
    root = study.path.parents[1]
    assert main(["study-results", "--scenes", str(root / "scenes"), "--build", str(tmp_path / "build"), "--answers", str(path.parent)]) == 0
    facts = json.loads((tmp_path / "build/study/results.json").read_text())
    assert facts["participants"] == 1 and facts["all"]["shown"] == 3 and facts["unfinished"] == 0
    right = sum(trial.answer == trial.true_side for trial in one.counted)
    assert facts["all"]["picked_true"] == right


def test_whole_run_by_touch_on_a_phone(visit, study, tmp_path):
    person = visit(viewport=PHONE, has_touch=True, is_mobile=True, device_scale_factor=2).come()
    person.page.tap("#begin")
    for button in ("#pick_b", "#pick_a", "#pick_b", "#pick_a"):
        assert person.page.evaluate("document.documentElement.scrollWidth <= innerWidth")
        person.page.tap("#show")
        person.ready()
        # large enough for a thumb (WCAG 2.5.5: 44 CSS pixels), within the screen, and no two pictures of different sizes
        for name in ("#pick_a", "#pick_b"):
            box = person.page.locator(name).bounding_box()
            assert box["height"] >= 44 and box["width"] >= 44 and box["y"] + box["height"] <= PHONE["height"]
        sizes = [person.page.locator(f"#{name} img").bounding_box() for name in ("a", "b", "clear")]
        assert (sizes[0]["width"], sizes[0]["height"]) == (sizes[1]["width"], sizes[1]["height"]) and sizes[0]["width"] > 150
        assert all(0 <= box["x"] and box["x"] + box["width"] <= PHONE["width"] for box in sizes)
        assert all(box["y"] + box["height"] <= PHONE["height"] for box in sizes)
        person.page.tap(button)
    one = read_answers(person.saved(tmp_path), study)
    assert [trial.answer for trial in one.trials] == ["B", "A", "B", "A"] and one.trials[0].pixel_ratio == 2


def test_the_side_in_the_file_is_where_the_true_one_was(visit, study, tmp_path):
    """What the page showed as A, compared with the picture that was given as true: JPEG keeps noise within a few codes."""
    person, shown = visit().come(), noise(study, (300, 400))
    person.page.keyboard.press(" ")
    seen = []
    while person.screen() == "ready":
        person.page.keyboard.press(" ")
        person.ready()
        seen.append(person.page.evaluate("""() => { const image = document.querySelector("#a img"), canvas = document.createElement("canvas");
            canvas.width = canvas.height = 32; const context = canvas.getContext("2d");
            context.drawImage(image, 0, 0); return Array.from(context.getImageData(0, 0, 32, 32).data); }"""))
        person.page.keyboard.press("a")
    for pixels, trial in zip(seen, read_answers(person.saved(tmp_path), study).trials):
        corner = np.reshape(pixels, (32, 32, 4))[..., :3]
        off = {side: np.abs(corner - one[:32, :32].astype(int)).mean()
               for side, one in (("A", shown[trial.stimulus].other), ("B", shown[trial.stimulus].synthetic))}
        assert min(off, key=off.get) == trial.true_side and min(off.values()) < 6 < max(off.values())


def test_time_runs_out(visit, study, tmp_path):
    person = visit().freeze()
    person.come()
    person.page.keyboard.press(" ")
    person.page.keyboard.press(" ")
    person.ready()
    person.pass_by(9000)
    assert person.screen() == "trial" and person.page.inner_text("#left") == "6 s" and not person.page.inner_text("#spoken")
    person.pass_by(1500)
    assert person.page.inner_text("#spoken") == "5 seconds left", "a screen reader says it once"
    person.pass_by(6000)
    assert person.screen() == "ready" and "time was over" in person.page.inner_text("#outcome")
    person.through()
    one = read_answers(person.saved(tmp_path), study)
    assert (one.trials[0].timed_out, one.trials[0].answer, one.trials[0].milliseconds) == (True, None, 15000)
    assert not any(trial.timed_out for trial in one.trials[1:])


def test_reload_in_the_middle_of_a_trial(visit, study, tmp_path):
    """It goes on with the same code, order and sides, in the same trial, and the time seen before counts."""
    person = visit().freeze()
    person.come()
    code = person.page.inner_text("#code")
    person.page.keyboard.press(" ")
    for _ in range(2):
        person.page.keyboard.press(" ")
        person.ready()
        if not person.kept()["trials"]:
            person.page.keyboard.press("a")
    person.pass_by(6000)
    before = person.kept()
    source = person.page.get_attribute("#a img", "src")
    person.page.reload()
    assert person.screen() == "ready" and "loaded again" in person.page.inner_text("#outcome")
    after = person.kept()
    assert (after["participant"], after["plan"], after["trials"]) == (code, before["plan"], before["trials"])
    person.page.keyboard.press(" ")
    person.ready()
    assert person.page.get_attribute("#a img", "src") == source
    person.pass_by(1000)
    person.page.keyboard.press("b")
    person.through()
    trial = read_answers(person.saved(tmp_path), study).trials[1]
    assert (trial.reloads, trial.times_hidden, trial.answer) == (1, 0, "B") and 6900 <= trial.milliseconds < 7300, "some ticks of 50 ms besides"


def test_reload_at_the_end_keeps_the_answers(visit, study, tmp_path):
    person = visit().come()
    person.through()
    first = person.page.input_value("#text")
    person.page.reload()
    assert person.screen() == "end" and person.page.input_value("#text") == first
    assert person.saved(tmp_path).read_text() == first, "the text to copy is the file"


def test_a_hidden_tab_stops_the_clock(visit, study, tmp_path):
    person = visit().freeze()
    person.page.add_init_script("""let hidden = false;
        Object.defineProperty(document, "hidden", { get: () => hidden });
        window.hide = (value) => { hidden = value; document.dispatchEvent(new Event("visibilitychange")); };""")
    person.come()
    person.page.keyboard.press(" ")
    person.page.keyboard.press(" ")
    person.ready()
    person.pass_by(2000)
    person.page.evaluate("hide(true)")
    person.pass_by(60_000)
    assert person.screen() == "trial"
    person.page.evaluate("hide(false)")
    person.pass_by(1000)
    person.page.keyboard.press("a")
    person.through()
    trial = read_answers(person.saved(tmp_path), study).trials[0]
    assert trial.times_hidden == 1 and trial.hidden_milliseconds == pytest.approx(60_000, abs=100)
    assert trial.milliseconds == pytest.approx(3000, abs=150) and not trial.timed_out


def test_time_does_not_run_before_the_pictures_are_there(visit, study, tmp_path):
    person = visit().freeze()
    person.page.add_init_script("""let free; const held = new Promise((done) => { free = done; }); window.free = free;
        const decode = HTMLImageElement.prototype.decode;
        HTMLImageElement.prototype.decode = async function () { await held; return decode.call(this); };""")
    person.come()
    person.page.keyboard.press(" ")
    person.page.keyboard.press(" ")
    person.pass_by(40_000)
    assert person.page.is_disabled("#pick_a") and not person.page.is_visible("#a img") and person.page.inner_text("#left") == "15 s"
    person.page.keyboard.press("a")
    assert person.screen() == "trial", "no answer before there is something to see"
    person.page.evaluate("free()")
    person.ready()
    person.page.keyboard.press("a")
    person.through()
    assert read_answers(person.saved(tmp_path), study).trials[0].milliseconds < 200


def test_order_and_sides_are_by_chance(visit, study):
    """1000 plans. All 6 orders of three stimuli within 5 standard errors of a sixth, each side of each stimulus of a half.

    Five standard errors of 1000 draws: 59 and 79; a fair plan is refused once in some 100,000 runs.
    """
    plans = visit().come().page.evaluate("Array.from({ length: 1000 }, () => study.plan())")
    assert all(plan[0]["id"] == "first" for plan in plans), "practice is first"
    orders = Counter(tuple(one["id"] for one in plan[1:]) for plan in plans)
    assert len(orders) == 6 and all(abs(count - 1000 / 6) < 5 * np.sqrt(1000 * 5 / 36) for count in orders.values())
    swapped = {name: [next(one["swapped"] for one in plan if one["id"] == name) for plan in plans] for name in ("plain", "dense", "told")}
    for drawn in swapped.values():
        assert set(drawn) == {0, 1} and abs(sum(drawn) - 500) < 5 * np.sqrt(250)
    # one side says nothing of another: correlation 0 within 5 / sqrt(1000)
    assert np.abs(np.corrcoef(list(swapped.values())) - np.eye(3)).max() < 5 / np.sqrt(1000)


def test_participants_differ(visit, study):
    codes = {visit().come().page.inner_text("#code") for _ in range(4)}
    assert len(codes) == 4 and all(re.fullmatch(r"[A-HJ-NP-Z2-9]{4}-[A-HJ-NP-Z2-9]{4}", code) for code in codes)


def test_somebody_else_begins_anew(visit):
    person = visit().come()
    person.through()
    before = person.kept()["participant"]
    person.page.click("summary >> nth=1")
    person.page.click("#anew")
    assert person.screen() == "welcome" and person.page.inner_text("#code") != before and not person.kept()["trials"]


@pytest.mark.parametrize("stored", ["nonsense", "null", "{}", '{"plan": [], "trials": [], "participant": "x"}',
                                    '{"plan": [{"id": "other", "swapped": 0}], "trials": [], "participant": "<b>x</b>"}'])
def test_what_is_stored_and_no_good_is_begun_anew(visit, stored):
    person = visit().come()
    key = person.page.evaluate("Object.keys(localStorage)[0]")
    person.page.evaluate("([key, value]) => localStorage.setItem(key, value)", [key, stored])
    person.page.reload()
    assert person.screen() == "welcome" and len(person.kept()["plan"]) == 4


def test_without_storage_the_page_says_so_and_works(visit, study, tmp_path):
    person = visit()
    person.page.add_init_script("Object.defineProperty(window, 'localStorage', { get() { throw new Error('none'); } })")
    person.come()
    assert person.page.is_visible("#unsaved")
    person.through()
    assert len(read_answers(person.saved(tmp_path), study).trials) == 4


def test_tab_goes_through_what_can_be_done(visit):
    """Focus is in the page's order, visible, and buttons answer to Enter; nothing that is hidden takes it."""
    person = visit().come()
    person.page.keyboard.press("Tab")
    assert person.page.evaluate("document.activeElement.id") == "begin"
    assert person.page.evaluate("getComputedStyle(document.activeElement).outlineStyle") == "solid"
    person.page.keyboard.press("Enter")
    person.page.keyboard.press("Tab")
    assert person.page.evaluate("document.activeElement.id") == "show"
    person.page.keyboard.press("Enter")
    person.ready()
    order = []
    for _ in range(2):
        person.page.keyboard.press("Tab")
        order.append(person.page.evaluate("document.activeElement.id"))
    assert order == ["pick_a", "pick_b"]
    person.page.keyboard.press("Enter")
    assert person.kept()["trials"][0]["answer"] == "B"


def test_names_and_roles_for_a_screen_reader(visit):
    person = visit().come()
    assert person.page.get_by_role("heading", name='Which is <the> "real" & true one?').is_visible()
    person.page.get_by_role("button", name="Begin").click()
    person.page.get_by_role("button", name="Show the pictures").click()
    person.ready()
    for name in ("the clear picture", "picture A, in fog", "picture B, in fog"):
        assert person.page.get_by_role("img", name=name).is_visible()
    assert person.page.get_by_role("timer").is_visible()
    assert person.page.get_by_role("group", name=re.compile("Which one is the real foggy photograph")).is_visible()
    assert person.page.evaluate("document.documentElement.lang") == "en"


@pytest.mark.parametrize("viewport", [PHONE, DESKTOP, {"width": 740, "height": 360}, {"width": 768, "height": 1024}])
def test_every_screen_fits(visit, viewport):
    person = visit(viewport=viewport).come()

    def fits():
        return person.page.evaluate("document.documentElement.scrollWidth <= innerWidth")

    assert fits()
    person.page.keyboard.press(" ")
    assert fits()
    person.page.keyboard.press(" ")
    person.ready()
    boxes = [person.page.locator(name).bounding_box() for name in ("#clear img", "#a img", "#b img", "#pick_a", "#pick_b", "#left")]
    assert all(b["x"] >= 0 and b["y"] >= 0 and b["x"] + b["width"] <= viewport["width"] + 0.5
               and b["y"] + b["height"] <= viewport["height"] + 0.5 for b in boxes)
    # nothing covers anything else
    for i, one in enumerate(boxes):
        for other in boxes[i + 1:]:
            assert (one["x"] + one["width"] <= other["x"] + 0.5 or other["x"] + other["width"] <= one["x"] + 0.5
                    or one["y"] + one["height"] <= other["y"] + 0.5 or other["y"] + other["height"] <= one["y"] + 0.5)
    # same proportions as the file's, so that no picture is stretched
    assert boxes[1]["width"] / boxes[1]["height"] == pytest.approx(400 / 300, rel=0.02)
    person.page.keyboard.press("a")
    person.through()
    assert fits()


def test_dark_neutral_surroundings(visit):
    """Equal channels, and contrast of text of 7 or more (WCAG 2, 1.4.6)."""
    person = visit().come()
    colours = person.page.evaluate("[getComputedStyle(document.body).backgroundColor, getComputedStyle(document.body).color, "
                                   "getComputedStyle(document.querySelector('.soft')).color]")
    back, *inks = ([int(x) for x in re.findall(r"\d+", one)[:3]] for one in colours)
    assert len(set(back)) == 1 and 20 < back[0] < 70

    def luminance(colour):
        linear = [(c / 255 / 12.92) if c / 255 <= 0.04045 else ((c / 255 + 0.055) / 1.055) ** 2.4 for c in colour]
        return np.dot([0.2126, 0.7152, 0.0722], linear)

    assert all((luminance(ink) + 0.05) / (luminance(back) + 0.05) >= 7 for ink in inks)


def test_strangers_words_stay_words(visit, study):
    """Title and labels hold markup; no element comes of it."""
    person = visit().come()
    assert person.page.title() == 'Which is <the> "real" & true one?'
    assert person.page.evaluate("document.querySelectorAll('the').length") == 0
    assert "<the>" in STUDY
