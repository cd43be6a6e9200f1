"""The tables of `make bench`, on made-up measurements: no time decides here."""

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.scene.artefacts import read_json
from tests.benchmarks import __main__ as bench
from tests.benchmarks import table
from tests.benchmarks.cases import Measured
from tests.benchmarks.table import Row
from tests.benchmarks.truth import errors

MACHINE = {"cpu": "Abacus, 3 beads", "cores": 2, "load": 0.3, "commit": "abc1234", "python": "3.12.1", "povray": "3.7.0.10",
           "mitsuba": {"version": "3.9.1", "variant": "scalar_rgb"}}
OURS = Row("cornell V", [2.0, 2.2, 9.0], 3.5, {"median": 0.004, "rms": 0.02})
THEIRS = [Row("cornell V Mitsuba 16", [2.0, 2.5, 2.0], 3.0, {"median": 0.4, "rms": 0.5}),
          Row("cornell V Mitsuba 64", [5.0, 5.5, 5.0], 9.0, {"median": 0.2, "rms": 0.25})]


def records(seconds: dict[str, float], date="2024-05-01", **of) -> list[dict[str, str]]:
    return table.records([Row(case, [value]) for case, value in seconds.items()], {**MACHINE, **of}, date)


def cells(text: str, begins: str, title: str = "# Benchmarks") -> list[str]:
    """Of the line of a table, under a title, whose first cell is `begins`."""
    lines = text[text.index(title):].splitlines()
    return [cell.strip() for cell in next(line for line in lines if line.startswith(f"| {begins} |")).split("|")[1:-1]]


def test_a_row_is_the_medians_of_its_rounds():
    rounds = [Measured(s, 2 * s, {"median": e}) for s, e in ((3.0, 0.01), (1.0, 0.03), (2.0, 0.02))]
    found = table.row("cornell T", rounds)
    assert (found.middle, found.processor, found.error) == (2.0, 4.0, 0.02) and found.seconds == [3.0, 1.0, 2.0]
    assert table.row("bathroom normal, relit", [Measured(1.0, 1.0)]).error is None


@pytest.mark.parametrize("seconds, errors, meets", [
    ([2.5], {"median": 0.01, "rms": 0.03}, True), ([2.6], {"median": 0.01, "rms": 0.03}, False),
    ([2.0], {"median": 0.011, "rms": 0.03}, False), ([2.0], {"median": 0.01, "rms": 0.031}, False)])
def test_what_is_asked(seconds, errors, meets):
    assert Row("cornell V", seconds, 1.0, errors).meets() is meets
    text = table.markdown([Row("cornell V", seconds, 1.0, errors)], MACHINE, "2024-05-02", [])
    assert cells(text, "cornell V")[-1] == ("yes" if meets else "**no**")
    assert cells(text, "cornell V")[-2] == "2.5 s, 1 % in the median, 3 % RMS"


def test_nothing_is_asked_of_other_cases():
    assert Row("bathroom final, all", [1e6]).meets() is None


def test_equal_error():
    """By hand: error 1.6/sqrt(paths), so 0.004 takes 160,000; a path takes 1/16 s after a start of 1 s."""
    found = table.equal_error(OURS, {16: THEIRS[0], 64: THEIRS[1]}, "median")
    assert found.paths == pytest.approx(160_000) and found.beyond == pytest.approx(2500)
    assert found.seconds == pytest.approx([10_001, 10_001.5, 10_001])
    assert found.times == pytest.approx(10_001.5 / 2.2), "the median of what each round says"


def test_what_mitsuba_would_take_is_said_to_be_extrapolated():
    text = table.markdown([OURS, *THEIRS], MACHINE, "2024-05-02", [])
    line = cells(text, "cornell V", "## At equal error")
    assert line[1] == "0.4 % in the median" and line[3] == "10,000" and line[-1] == "extrapolated from 64 paths"
    crude = Row("cornell V", [2.0], 1.0, {"median": 0.3, "rms": 0.3})
    assert cells(table.markdown([crude, *THEIRS], MACHINE, "2024-05-02", []), "cornell V",
                 "## At equal error")[-1] == "measured between"
    assert "vectorised variants do not work here" in text
    fast = {**MACHINE, "mitsuba": {"version": "3.9.1", "variant": "llvm_ad_rgb"}}
    assert "vectorised variants" not in table.markdown([OURS, *THEIRS], fast, "2024-05-02", [])


def test_without_mitsuba_its_rows_are_left_out():
    text = table.markdown([OURS], {**MACHINE, "mitsuba": None}, "2024-05-02", [])
    assert "Left out: Mitsuba 3 is not installed; run: make setup-mitsuba" in text
    assert table.equal_errors([OURS]) == {}, "nor with ours alone"
    assert table.equal_errors(THEIRS) == {}, "nor with theirs alone"


def test_slowdowns_are_marked():
    now = [Row(case, [seconds]) for case, seconds in (("even", 1.19), ("slow", 1.21), ("quick", 0.5), ("new", 1.0))]
    text = table.markdown(now, MACHINE, "2024-05-02", records({"even": 1.0, "slow": 1.0, "quick": 1.0, "gone": 1.0}))
    trend = text[text.index("## Trend"):]
    assert cells(trend, "even", "##") == ["even", "2024-05-01 abc1234", "1.00", "1.19", "+19%", ""]
    assert cells(trend, "slow", "##")[-2:] == ["+21%", "**slower**"] and cells(trend, "quick", "##")[-2:] == ["-50%", ""]
    assert "| new |" not in trend and "| gone |" not in trend


def test_the_trend_is_against_the_last_record_of_the_same_machine():
    history = (records({"even": 5.0}) + records({"even": 1.0}, "2024-05-02", commit="def5678")
               + records({"even": 9.0}, "2024-05-03", cores=64) + records({"even": 9.0}, "2024-05-03", cpu="Other"))
    assert cells(table.markdown([Row("even", [1.1])], MACHINE, "2024-05-04", history), "even",
                 "## Trend")[1:] == ["2024-05-02 def5678", "1.00", "1.10", "+10%", ""]
    elsewhere = table.markdown([Row("even", [1.1])], {**MACHINE, "cores": 3}, "2024-05-04", history)
    assert "Nothing is recorded of such a machine" in elsewhere


def test_history_reads_back():
    kept = table.records([OURS, Row("with, comma", [1.0])], MACHINE, "2024-05-01")
    text = table.history_text(kept)
    assert table.read_history(text) == kept and text.splitlines()[0] == "date,commit,cpu,cores,case,seconds,error"
    assert table.read_history(table.history_text(table.read_history(text) + kept)) == kept + kept
    assert kept[0]["seconds"] == "2.200" and kept[0]["error"] == "0.004" and kept[1]["error"] == ""


def test_errors_of_pixels():
    true = np.array([[1.0, 2.0, 4.0], [np.nan] * 3, [2.0, 2.0, 2.0], [0.0, 0.0, 0.0]])
    found = true * [[1.01, 0.98, 1.0]]
    assert errors(found, true)["median"] == pytest.approx(0.02)
    # differences 0.01, 0.04, 0, 0.02, 0.04, 0 over values 1, 2, 4, 2, 2, 2
    assert errors(found, true)["rms"] == pytest.approx(np.sqrt(0.0037 / 33))
    assert errors(np.full_like(true, np.nan), true)["rms"] == pytest.approx(1.0), "what is not found is black"


@pytest.fixture
def made_up(monkeypatch, tmp_path):
    """Two cases whose seconds are the number of the round, and the project's own files in a folder of the test."""
    works = {name: lambda number, name=name: {f"{name}, all": Measured(float(number), 1.0), name: Measured(2.0 * number, 1.0)}
             for name in ("second", "first")}
    monkeypatch.setattr(bench.cases, "works", lambda folder, mitsuba, only: {n: w for n, w in works.items() if only in n})
    monkeypatch.setattr(bench.machine, "described", lambda: MACHINE)
    for name, file in (("HISTORY", "history.csv"), ("RESULTS", "results.md")):
        monkeypatch.setattr(bench, name, tmp_path / file)
    return tmp_path


def test_only_a_record_changes_what_the_project_carries(made_up, capsys):
    bench.run(made_up, 3, "", record=False)
    assert not bench.HISTORY.exists() and not bench.RESULTS.exists()
    text = (made_up / "bench.md").read_text()
    assert text == capsys.readouterr().out.removesuffix("\n") and "Nothing is recorded" in text
    assert [one["case"] for one in read_json(made_up / "bench.json")["rows"]] == [
        "second, all", "second", "first, all", "first"], "in the order of the cases, whichever came first"
    for _ in range(2):
        bench.run(made_up, 3, "", record=True)
    assert "+0%" in bench.RESULTS.read_text(), "against the first record"
    kept = table.read_history(bench.HISTORY.read_text())
    assert [(one["case"], one["seconds"]) for one in kept] == 2 * [
        ("second, all", "2.000"), ("second", "4.000"), ("first, all", "2.000"), ("first", "4.000")]


@pytest.mark.parametrize("repeats, only, record, says", [
    (0, "", False, "repeats=0; give a number"), (1, "second", True, "record all cases"), (1, "third", False, "no case")])
def test_refusals(made_up, repeats, only, record, says):
    with pytest.raises(InputError, match=says):
        bench.run(made_up, repeats, only, record)
