"""The user study's description, pictures, page and answer files: what is shown, what is hidden, what is refused."""

from __future__ import annotations

import base64
import csv
import hashlib
import html
import json
import os
import re
import shutil

import cv2
import imagecodecs
import numpy as np
import pytest

from pipeline.cli import main
from pipeline.errors import InputError
from pipeline.imaging.display import displayed
from pipeline.imaging.maps import read_map, write_map
from pipeline.paths import PROJECT, Build
from pipeline.study.answers import MAX_BYTES, collect, read_answers
from pipeline.study.description import read_study
from pipeline.study.page import page
from pipeline.study.simulated import participants
from pipeline.study.stimuli import LONGEST, PANEL, common_size, densities, one_stimulus, pictures, sheet
from tests.study_fixture import STUDY, answers, made, noise, write_study


def refused(call) -> str:
    with pytest.raises(InputError) as caught:
        call()
    line = str(caught.value)
    assert "\n" not in line and len(line) < 1500
    return line


# ---- description ------------------------------------------------------------------------------

def test_a_study_is_read(tmp_path):
    study = made(tmp_path)
    assert [one.name for one in study.stimuli] == ["first", "plain", "dense", "told"]
    assert [one.practice for one in study.stimuli] == [True, False, False, False]
    assert [one.kind for one in study.counted] == ["photograph", "photograph", "rendered truth"]
    assert [one.density for one in study.counted] == ["dense fog, 6 m", "heavy <b>fog</b>", "dense fog, 2 m"]
    assert study.counted[1].build.foggy(".exr") == tmp_path / "build/tiny/thick/foggy.exr"
    assert study.folder == tmp_path / "build/study"


def test_another_study_has_a_folder_of_its_own(tmp_path):
    path = write_study(tmp_path)
    shutil.copy(path, path.with_name("kitchen.yaml"))
    assert read_study(path.with_name("kitchen.yaml"), tmp_path / "scenes", tmp_path / "build").folder == tmp_path / "build/study/kitchen"


@pytest.mark.parametrize("old, new, told", [
    ("seconds: 15", "seconds: 0", ("study.yaml:2: seconds = 0", "or more [s]")),
    ("seconds: 15", "secnods: 15", ("study.yaml:2", "unknown key", "did you mean 'seconds'")),
    ("plain: {scene: tiny, real: photos/real.png}", "plain: {scene: tiny}", ("study.yaml:6", "held against nothing", "truth: true")),
    ("fog: thick, truth: true", "fog: thick, truth: true, real: photos/real.png", ("study.yaml:8", "both 'real' and 'truth'")),
    ("photos/real.png}\nstimuli", "../../secret.png}\nstimuli", ("study.yaml:4", "leads out of the study's folder")),
    ("photos/real.png}\nstimuli", "/etc/passwd}\nstimuli", ("study.yaml:4", "leads out of the study's folder")),
    ("photos/real.png}\nstimuli", "photos/none.png}\nstimuli", ("study.yaml:4", "no such file", "put the photograph there")),
    ("photos/real.png}\nstimuli", "photos}\nstimuli", ("study.yaml:4", "no such file")),
    ("fog: thick, truth", "fog: thcik, truth", ("study.yaml:8", "no fog is called 'thcik'", "did you mean 'thick'")),
    ("told: {scene: tiny", "told: {scene: tny", ("study.yaml:8", "no such scene file", "did you mean 'tiny'")),
    ("told: {scene: tiny", "told: {scene: ../tiny", ("study.yaml:8", "told.scene")),
    ("told: {scene: tiny", "told: {scene: study", ("study.yaml:8", "scene name 'study'")),
    ("told: {scene: tiny, fog: thick,", "told: {scene: tiny,", ("study.yaml:8", "no rendered truth", "make study-truth scene=tiny fogs=default")),
    ("first:", "plain:", ("study.yaml:4", "'plain' is a stimulus, too")),
    ("plain:", "3plain:", ("study.yaml:6", "a name of letters")),
    ("heavy <b>fog</b>", '"heavy\\nfog"', ("study.yaml:7", "density")),
    (STUDY, "", ("study.yaml:1", "the study file is empty")),
    (STUDY, "stimuli: {}", ("study.yaml:1", "at least 1 entries")),
])
def test_a_mistake_in_the_description_is_one_line(tmp_path, old, new, told):
    line = refused(lambda: made(tmp_path, STUDY.replace(old, new, 1)))
    assert all(words in line for words in told), line


def test_no_description(tmp_path):
    assert "none.yaml: no such study file; write it" in refused(lambda: read_study(tmp_path / "none.yaml"))


@pytest.mark.parametrize("old, new, same", [
    ("title: Which", "title: What", True), ("heavy <b>fog</b>", "heavy", True),
    ("seconds: 15", "seconds: 14", False), ("fog: thick, real", "real", False),
    ("plain: {scene: tiny, real", "plainer: {scene: tiny, real", False)])
def test_the_digest_tells_what_makes_another_study(tmp_path, old, new, same):
    assert (made(tmp_path, STUDY.replace(old, new, 1)).digest == made(tmp_path).digest) == same


def test_the_digest_knows_the_fog(tmp_path):
    before, scene = made(tmp_path).digest, tmp_path / "scenes/tiny/scene.yaml"
    scene.write_text(scene.read_text().replace("visibility: 2\n", "visibility: 3\n"))
    assert made(tmp_path).digest != before


# ---- pictures ---------------------------------------------------------------------------------

@pytest.fixture(scope="module")
def rendered(tmp_path_factory):
    """The study with the tiny scene's photograph read, two foggy photographs of it, and the truth of one of them."""
    root = tmp_path_factory.mktemp("study")
    write_study(root)
    options = ["--scene", "tiny", "--scenes", str(root / "scenes"), "--build", str(root / "build")]
    assert main(["resolve", *options]) == main(["photograph", *options]) == 0
    for number, fog in enumerate((None, "thick"), 1):
        build = Build("tiny", fog, root / "scenes", root / "build")
        build.out.mkdir(exist_ok=True)
        write_map(build.foggy(".exr"), read_map(build.photograph) / (1 + number) + 0.1 * number)
    medium = made(root).stimuli[-1].medium
    absorption, scattering = medium.coefficients()
    write_map(build.carried_truth, read_map(build.foggy(".exr")) * 0.9, {
        "fog:absorption_coefficient_per_m": tuple(absorption), "fog:scattering_coefficient_per_m": tuple(scattering),
        "fog:asymmetry": medium.phase().asymmetry, "fog:content": "for a test"})
    return root


def of(root, name):
    return next(one for one in made(root).stimuli if one.name == name)


def test_all_three_go_through_the_same(rendered):
    """The truth of this test is 0.9 times the composite in linear light: shown, it must be just that."""
    told = of(rendered, "told")
    shown = pictures(told)
    foggy = read_map(told.build.foggy(".exr"))
    assert shown.clear.shape == shown.synthetic.shape == shown.other.shape == (18, 24, 3)
    assert (shown.synthetic == displayed(foggy)).all() and (shown.other == displayed(foggy * np.float32(0.9))).all()
    codes = imagecodecs.png_decode((told.build.source / "photograph.png").read_bytes())
    assert (shown.clear == codes).all(), "an 8-bit photograph that is not shrunk comes back as it was"


def test_a_real_photograph_is_shown_as_it_is(rendered):
    plain = of(rendered, "plain")
    assert (pictures(plain).other == imagecodecs.png_decode(plain.other.read_bytes())).all()


@pytest.mark.parametrize("clear, other, size", [
    ((18, 24), (18, 24), (18, 24)), ((1800, 2400), (1800, 2400), (675, LONGEST)), ((1800, 2400), (450, 600), (450, 600)),
    ((600, 400), (6000, 4000), (600, 400)), ((1, 5000), (1, 5000), (1, LONGEST))])
def test_no_picture_is_enlarged(clear, other, size):
    assert common_size(clear, other) == size


def test_a_smaller_real_photograph_sets_the_size_of_all(rendered):
    photo = rendered / "scenes/photos/half.png"
    photo.write_bytes(imagecodecs.png_encode(np.full((9, 12, 3), 77, np.uint8)))
    shown = pictures(next(one for one in made(rendered, STUDY.replace("plain: {scene: tiny, real: photos/real.png",
                                                                      "plain: {scene: tiny, real: photos/half.png")).stimuli
                          if one.name == "plain"))
    assert {one.shape for one in (shown.clear, shown.synthetic, shown.other)} == {(9, 12, 3)}
    assert (shown.other == 77).all()


def test_a_photograph_of_other_proportions_is_refused(rendered):
    photo = rendered / "scenes/photos/wide.png"
    photo.write_bytes(imagecodecs.png_encode(np.zeros((18, 32, 3), np.uint8)))
    study = made(rendered, STUDY.replace("plain: {scene: tiny, real: photos/real.png", "plain: {scene: tiny, real: photos/wide.png"))
    line = refused(lambda: pictures(study.counted[0]))
    assert "study.yaml:6" in line and "32x18" in line and "crop it" in line


@pytest.mark.parametrize("key, value", [("fog:scattering_coefficient_per_m", (1.0, 1.0, 1.0)), ("fog:asymmetry", 0.123)])
def test_the_truth_of_another_fog_is_refused(rendered, key, value):
    from pipeline.imaging.maps import read_metadata

    told = of(rendered, "told")
    kept = told.other.read_bytes()
    metadata = {k: v for k, v in read_metadata(told.other).items() if k.startswith("fog:")}
    write_map(told.other, read_map(told.other), {**metadata, key: value})
    try:
        line = refused(lambda: pictures(told))
    finally:
        told.other.write_bytes(kept)
    assert "study.yaml:8" in line and "another fog" in line and "make study-truth scene=tiny fogs=thick" in line


def test_a_fog_that_was_not_made(tmp_path):
    line = refused(lambda: pictures(made(tmp_path).counted[1]))
    assert "foggy.exr: no such file; run: make scene=tiny fog=thick" in line


def test_sheets_show_every_picture(tmp_path):
    study = made(tmp_path)
    shown = noise(study, (390, PANEL))  # the size of a panel: nothing is scaled

    def holds(sheet, picture) -> bool:
        """Whether the sheet has a part of the picture. Noise elsewhere correlates below 0.9."""
        return float(cv2.matchTemplate(sheet, picture[10:26, 10:42], cv2.TM_CCOEFF_NORMED).max()) > 0.999

    whole = sheet(study, shown)
    assert all(holds(whole, shown[one.name].synthetic) and holds(whole, shown[one.name].other) for one in study.counted)
    assert holds(whole, shown["plain"].clear) and not holds(whole, shown["first"].other), "what is practised is no figure"
    three = one_stimulus(study.counted[0], shown["plain"])
    assert all(holds(three, picture) for picture in (shown["plain"].clear, shown["plain"].synthetic, shown["plain"].other))
    # a density's real picture stands below its synthetic one
    place = [cv2.minMaxLoc(cv2.matchTemplate(whole, picture[10:26, 10:42], cv2.TM_CCOEFF_NORMED))[3]
             for picture in (shown["dense"].synthetic, shown["dense"].other)]
    assert place[0][0] == place[1][0] and place[1][1] > place[0][1] + 390


def test_many_densities_take_further_rows(tmp_path):
    study = made(tmp_path)
    one = study.counted[0]
    shown = noise(study, (40, 60))["plain"]
    assert densities([one] * 7, [shown] * 7).shape[0] > 1.9 * densities([one] * 5, [shown] * 5).shape[0]


# ---- page -------------------------------------------------------------------------------------

@pytest.fixture(scope="module")
def written(tmp_path_factory):
    study = made(tmp_path_factory.mktemp("page"))
    return study, *page(study, noise(study))


def data_of(text: str) -> dict:
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.S)[1])


def test_the_page_needs_nothing_from_outside(written):
    text = re.sub(r"data:image/jpeg;base64,[A-Za-z0-9+/=]+", "", written[1])
    assert not re.search(r"https?:|//[a-z]|@import|url\(", text.replace("// ", ""))
    assert not re.search(r"\b(src|href)=", text), "pictures come from the data, by the script"


def test_only_its_own_script_and_style_may_run(written):
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', written[1])[1]
    policy = html.unescape(policy)
    assert "default-src 'none'" in policy and "unsafe" not in policy and "*" not in policy
    for tag in ("script", "style"):
        block = re.search(rf"<{tag}>(.*?)</{tag}>", written[1], re.S)[1]
        digest = base64.b64encode(hashlib.sha256(block.encode()).digest()).decode()
        assert f"{tag}-src 'sha256-{digest}'" in policy


def test_texts_of_the_description_are_escaped(written):
    study, text, _ = written
    assert "Which is &lt;the&gt; &#34;real&#34; &amp; true one?" in text
    assert "<the>" not in text and "<b>fog</b>" not in text
    assert data_of(text)["stimuli"][2]["density"] == "heavy <b>fog</b>", "in the data it stands as it was"


def test_nothing_before_the_answer_says_which_one_is_true(tmp_path):
    """Over 150 pages the true one is first of its pair as often as not (four standard errors: 0.17), by the table alone."""
    study, first, marks = made(tmp_path), [], []
    shown = noise(study, (8, 8))
    for number in range(150):
        shown["plain"].other[:4, :4] = number
        text, _ = page(study, shown)
        data = data_of(text)
        truth = cv2.imencode(".jpg", shown["plain"].other[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 92, cv2.IMWRITE_JPEG_SAMPLING_FACTOR,
                                                                     cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444])[1].tobytes()
        index = data["pictures"].index("data:image/jpeg;base64," + base64.b64encode(truth).decode())
        one = next(one for one in data["stimuli"] if one["id"] == "plain")
        place = one["pair"].index(index)
        assert one["mark"].bit_count() % 2 == place, "the mark's parity says it"
        first.append(place)
        marks.append(one["mark"] & 1)
    assert abs(np.mean(first) - 0.5) < 0.17 and abs(np.mean(marks) - 0.5) < 0.17
    # neither the order in the list, nor the mark's last bit, goes with it
    assert abs(np.corrcoef(first, marks)[0, 1]) < 4 / np.sqrt(150)


def test_pictures_have_one_encoding_and_no_metadata(written):
    study, text, record = written
    blobs = [base64.b64decode(uri.partition(",")[2]) for uri in data_of(text)["pictures"]]
    assert len(blobs) == 2 * len(study.stimuli) + 1, "one clear picture for all, two foggy ones each"

    def segments(blob: bytes) -> list[tuple[int, bytes]]:
        """Markers (ITU T.81, B.1.1.4) before the picture's data."""
        at, found = 2, []
        while blob[at + 1] != 0xDA:
            length = int.from_bytes(blob[at + 2:at + 4], "big")
            found.append((blob[at + 1], blob[at + 4:at + 2 + length]))
            at += 2 + length
        return found

    every = [segments(blob) for blob in blobs]
    assert {marker for one in every for marker, _ in one} <= {0xE0, 0xDB, 0xC0, 0xC4}, "no EXIF, profile or comment"
    heads = [[part for part in one if part[0] in (0xE0, 0xDB, 0xC0)] for one in every]
    assert all(head == heads[0] for head in heads), "same size, sampling and quantisation"
    assert record["stimuli"]["told"]["size_pixel"] == (80, 60)


def test_the_same_pictures_make_the_same_page(tmp_path, written):
    study = made(tmp_path)
    assert page(study, noise(study))[0] == written[1]


# ---- answer files -----------------------------------------------------------------------------

def saved(folder, value, name="answers.json"):
    folder.mkdir(exist_ok=True)
    path = folder / name
    path.write_text(value if isinstance(value, str) else json.dumps(value))
    return path


def test_a_good_file_is_read(tmp_path):
    study = made(tmp_path)
    one = read_answers(saved(tmp_path / "a", answers(study)), study)
    assert one.participant == "ABCD-EFGH" and len(one.counted) == 3 and all(trial.right for trial in one.trials)


def changed(path: str, value):
    """A change of a good file at a path such as trials.1.answer; `...` removes the key."""
    def change(content):
        *parts, last = [int(p) if p.isdecimal() else p for p in path.split(".")]
        node = content
        for part in parts:
            node = node[part]
        if value is ...:
            del node[last]
        else:
            node[last] = value
        return content
    return change


DEEP = "[" * 100_000
BAD = [
    ("not JSON", lambda c: "{\n 'a': 1}", ("answers.json:2: is no JSON", "save it again")),
    ("empty", lambda c: "", ("answers.json:1: is no JSON",)),
    ("deep", lambda c: DEEP, ("nested too deeply",)),
    ("not a number", lambda c: json.dumps(c).replace('"milliseconds": 1000', '"milliseconds": NaN'), ("NaN is no number",)),
    ("endless digits", lambda c: json.dumps(c).replace('"milliseconds": 1000', '"milliseconds": ' + "9" * 10_000), ("cannot be read",)),
    ("infinite", lambda c: json.dumps(c).replace('"pixel_ratio": 2', '"pixel_ratio": 1e999'), ("trials[0].pixel_ratio",)),
    ("too large", lambda c: " " * (MAX_BYTES + 1), (f"below {MAX_BYTES} bytes",)),
    ("something else", lambda c: {"name": "value"}, ("is no answer file of a study", "remove it from the folder")),
    ("a list", lambda c: [c], ("is no answer file of a study",)),
    ("later version", changed("version", 2), ("version = 2", "reads version 1")),
    ("another study", changed("study", "0" * 16), ("answers another study, 0000000000000000", "study=FILE")),
    ("other seconds", changed("seconds_allowed", 30), ("seconds_allowed = 30",)),
    ("a name", changed("participant", "<script>alert(1)</script>"), ("participant", "save it again")),
    ("simulated", changed("participant", "SIM-1"), ("is simulated", "only people count")),
    ("unknown key", changed("email", "me@example.org"), ("email: Extra inputs",)),
    ("missing key", changed("trials.1.answer", ...), ("trials[1].answer: Field required",)),
    ("a side", changed("trials.1.answer", "C"), ('trials[1].answer = "C"',)),
    ("text for a number", changed("trials.0.milliseconds", "12"), ('trials[0].milliseconds = "12"',)),
    ("too long", changed("trials.0.milliseconds", 20_000), ("trials[0].milliseconds = 20000, more than was allowed",)),
    ("negative", changed("trials.0.milliseconds", -1), ("trials[0].milliseconds = -1",)),
    ("unknown stimulus", changed("trials.1.stimulus", "=cmd()"), ('trials[1].stimulus = "=cmd()" is none of the study',)),
    ("twice", changed("trials.2.stimulus", "plain"), ('trials[2].stimulus = "plain" was answered before',)),
    ("order", changed("trials.1.order", 9), ("trials[1].order = 9",)),
    ("kind", changed("trials.1.true_is", "rendered truth"), ("trials[1].true_is",)),
    ("practice counts", changed("trials.0.practice", False), ("trials[0].practice = false, in the study it is true",)),
    ("timed out, yet answered", changed("trials.1.timed_out", True), ("trials[1].timed_out = true",)),
    ("huge key", lambda c: {**c, "k" * 100_000: 1}, ("Extra inputs",)),
]


@pytest.mark.parametrize("change, told", [case[1:] for case in BAD], ids=[case[0] for case in BAD])
def test_a_bad_file_is_one_line(tmp_path, change, told):
    study = made(tmp_path)
    line = refused(lambda: read_answers(saved(tmp_path / "a", change(answers(study))), study))
    assert all(words in line for words in told), line


def test_bad_files_are_left_out_and_good_ones_count(tmp_path):
    study, folder = made(tmp_path), tmp_path / "a"
    saved(folder, answers(study), "1.json")
    saved(folder, answers(study), "2.json")                                  # a copy
    saved(folder, answers(study, right=False), "3.json")                     # the same code, other answers
    saved(folder, answers(study, "BBBB-CCCC"), "4.JSON")
    saved(folder, "nonsense", "5\n\x1b[31m.json")
    saved(folder, "never read", "notes.txt")
    (folder / "6.json").symlink_to("/dev/zero")
    os.mkfifo(folder / "7.json")
    found = collect(folder, study)
    assert [one.participant for one in found.participants] == ["ABCD-EFGH", "BBBB-CCCC"]
    lines = found.left_out
    assert len(lines) == 5 and all("\n" not in line and "\x1b" not in line for line in lines)
    assert "2.json: participant ABCD-EFGH is a copy of" in lines[0] and "differs from" in lines[1]
    assert all("is no plain file" in line for line in lines if "6.json" in line or "7.json" in line)


def test_no_good_file_at_all(tmp_path):
    saved(tmp_path / "a", "nonsense")
    line = refused(lambda: collect(tmp_path / "a", made(tmp_path)))
    assert "none of 1 answer files can be used" in line and "answers.json:1" in line


def test_no_such_folder(tmp_path):
    assert "answers=FOLDER" in refused(lambda: collect(tmp_path / "none", made(tmp_path)))


# ---- results ----------------------------------------------------------------------------------

def results(root, *options) -> int:
    return main(["study-results", "--scenes", str(root / "scenes"), "--build", str(root / "build"), *options])


def read_results(root, which="results"):
    folder = root / "build/study"
    with open(folder / f"{which}.csv", newline="") as file:
        return json.loads((folder / f"{which}.json").read_text()), list(csv.DictReader(file))


def test_results_of_a_folder(tmp_path, capsys):
    study = made(tmp_path)
    for code in ("AAAA", "BBBB", "CCCC", "DDDD", "EEEE", "FFFF", "GGGG"):
        saved(tmp_path / "a", answers(study, f"{code}-{code}"), f"{code}.json")
    saved(tmp_path / "a", "{", "bad.json")
    assert results(tmp_path, "--answers", str(tmp_path / "a")) == 0
    facts, rows = read_results(tmp_path)
    assert facts["participants"] == 7 and facts["simulated"] is False and len(facts["left_out"]) == 1
    assert [row["name"] for row in rows] == ["plain", "dense", "told", "all"]
    # seven of seven: 2 / 2^7, times three for Holm
    assert float(rows[0]["p"]) == pytest.approx(2 / 128) and float(rows[0]["p_holm"]) == pytest.approx(6 / 128)
    assert float(rows[3]["p"]) == pytest.approx(2 / 2**21)
    said = capsys.readouterr()
    assert said.err.startswith("left out: ") and "7 participants" in said.out


def test_without_answers_nobody_is_invented(tmp_path, capsys):
    made(tmp_path)
    assert results(tmp_path) == 0
    facts, rows = read_results(tmp_path)
    assert facts["participants"] == 0 and facts["note"] == "no answers have been collected"
    assert all(row["picked_true"] == "0" and row["share"] == "" for row in rows)
    assert "no answers were collected" in capsys.readouterr().out


def test_simulated_ones_say_so_wherever_they_are(tmp_path, capsys):
    made(tmp_path)
    assert results(tmp_path, "--simulate", "40") == 0
    facts, rows = read_results(tmp_path, "simulated_results")
    assert facts["simulated"] is True and "SIMULATED" in facts["note"] and all(row["simulated"] == "True" for row in rows)
    assert "40 SIMULATED participants" in capsys.readouterr().out
    assert not (tmp_path / "build/study/results.json").exists()
    drawing = tmp_path / "build/study/simulated_results.svg"
    if drawing.exists():
        assert "SIMULATED" in drawing.read_text()


@pytest.mark.parametrize("options, told", [(("--simulate", "40", "--answers", "x"), "give one of them"),
                                           (("--simulate", "0"), "whole number from 1"), (("--simulate", "9" * 400), "whole number"),
                                           (("--simulate", "-3"), "command line")])
def test_what_makes_no_sense_is_refused(tmp_path, capsys, options, told):
    made(tmp_path)
    assert results(tmp_path, *options) == 2
    assert told in capsys.readouterr().err


def test_the_figure_shows_the_numbers(tmp_path):
    pytest.importorskip("matplotlib", reason="no picture without matplotlib: make setup-figures")
    study = made(tmp_path)
    for number, right in enumerate([True] * 7 + [False] * 2):
        code = f"{'ABCDEFGHJ'[number] * 4}-AAAA"
        saved(tmp_path / "a", answers(study, code, right), f"{number}.json")
    assert results(tmp_path, "--answers", str(tmp_path / "a")) == 0
    folder = tmp_path / "build/study"
    drawn = (folder / "results.svg").read_text()
    assert "9 participants" in drawn and "78 %" in drawn and "heavy &lt;b&gt;fog&lt;/b&gt;" in drawn and "SIMULATED" not in drawn
    assert "<b>fog" not in drawn
    picture = cv2.imread(str(folder / "results.png"))
    blue = (np.abs(picture.astype(int) - [178, 114, 0]).max(-1) < 12).sum()
    orange = (np.abs(picture.astype(int) - [0, 159, 230]).max(-1) < 12).sum()
    # bars of 7 and 2; hatching and numbers take some of the orange
    assert 2 < blue / orange < 8
    before = (folder / "results.svg").read_bytes()
    assert results(tmp_path, "--answers", str(tmp_path / "a")) == 0 and (folder / "results.svg").read_bytes() == before


def test_simulated_answers_are_what_a_page_could_have_saved(tmp_path):
    study = made(tmp_path)
    people = participants(study, 200, 3)
    assert {tuple(trial.stimulus for trial in one.counted) for one in people} > {("plain", "dense", "told")}, "their order differs"
    assert participants(study, 5, 3) == people[:5] and participants(study, 5, 4) != people[:5]


def test_the_study_that_the_project_carries():
    """Its scenes and fogs are there, and each truth is of the fog as it stands."""
    study = read_study(PROJECT / "scenes/study.yaml", PROJECT / "scenes")
    assert len(study.counted) >= 4 and all(one.kind == "rendered truth" for one in study.stimuli)
    from pipeline.study.stimuli import _truth

    for one in study.stimuli:
        size = read_map(one.build.source / "photograph.exr").shape[:2]
        assert np.isfinite(_truth(one, size)).all()
