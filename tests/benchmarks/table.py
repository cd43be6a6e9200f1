"""What was measured as a table; what Mitsuba would take for the same error; and how both were at the last record."""

from __future__ import annotations

import csv
import io
import re
from dataclasses import dataclass, field
from statistics import geometric_mean, median

FIELDS = ["date", "commit", "cpu", "cores", "case", "seconds", "error"]
#: Slower by this factor than at the last record is marked.
SLOWER = 1.2
#: What is asked of a case: seconds [s] and relative errors.
ASKED = {"cornell V": {"seconds": 2.5, "median": 0.01, "rms": 0.03}, "cornell T": {"seconds": 1.5, "median": 0.005},
         "bathroom draft, rendering": {"seconds": 2.0}, "bathroom normal, rendering": {"seconds": 6.0},
         "building draft, rendering": {"seconds": 2.0}, "building normal, rendering": {"seconds": 6.0}}
WORDS = {"median": "{} in the median", "rms": "{} RMS", "checked": "{}", "estimated": "says {} of itself",
         "at_most": "at most {}"}
#: Said below the head, and below the comparison.
HOW = ("Medians of {rounds}, in which all cases take turns. Wall time of processes of their own, their start included; nothing"
       " was rendered before. Processor: seconds of all cores together, which others' work on the machine changes less. Errors"
       " of T and V: against quadrature, at 1500 pixels; of fogs: at 300 that were made as finely as it takes, beside what the"
       " fog says of itself by fewer.")
EQUALLY = ("Single scattering (volpath, max_depth 2) of the exported scene, start and loading included, errors at the same pixels;"
           " T is a ratio of two of its renders. Its error is extrapolated as if it always fell with the square root of the"
           " paths, though its pixels are averages and the truth is of their centres.")
SCALAR = " Its vectorised variants do not work here; where they do they may be several times as fast."
MITSUBA = re.compile(r"(cornell [VT]) Mitsuba (\d+)")


@dataclass(frozen=True)
class Row:
    """A case: seconds [s] of each round; medians over the rounds of processor time [s], 0 where it is not known, and of its errors."""

    case: str
    seconds: list[float]
    processor: float = 0.0
    errors: dict[str, float] = field(default_factory=dict)

    @property
    def middle(self) -> float:
        return median(self.seconds)

    @property
    def error(self) -> float | None:
        """The first of them, which is what history keeps."""
        return next(iter(self.errors.values()), None)

    def meets(self) -> bool | None:
        """Whether it is as quick and as right as asked, None where nothing is asked."""
        asked = ASKED.get(self.case)
        if asked is None:
            return None
        return all((self.middle if name == "seconds" else self.errors.get(name, float("inf"))) <= most
                   for name, most in asked.items())


def row(case: str, measured: list) -> Row:
    """Of what each round measured: `seconds`, `processor` and `errors`."""
    errors = {name: median(one.errors[name] for one in measured) for name in measured[0].errors}
    return Row(case, [float(one.seconds) for one in measured], float(median(one.processor for one in measured)), errors)


# ---- equal error ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Equal:
    """Mitsuba at the error of our map: paths a pixel, seconds [s] of each round, how many times as many as ours in the
    median of the rounds, and how many times as many paths as were measured."""

    measure: str
    error: float
    paths: float
    seconds: list[float]
    times: float
    beyond: float


def equal_error(ours: Row, theirs: dict[int, Row], measure: str) -> Equal:
    """theirs: Mitsuba's rows by paths a pixel. Error falls with the square root of the paths; seconds are a start and so
    many a path, from the fewest and the most that were measured in the same round."""
    factor = geometric_mean(one.errors[measure] * count**0.5 for count, one in theirs.items())
    paths = (factor / ours.errors[measure]) ** 2
    few, many = min(theirs), max(theirs)
    seconds = []
    for short, long in zip(theirs[few].seconds, theirs[many].seconds):
        a_path = max(long - short, 0.0) / (many - few)
        seconds.append(max(long + a_path * (paths - many), 0.0))
    times = median(them / us for them, us in zip(seconds, ours.seconds))
    return Equal(measure, ours.errors[measure], paths, seconds, times, paths / many)


def equal_errors(rows: list[Row]) -> dict[str, list[Equal]]:
    """By our case, for the median and for the root mean square."""
    by_case, theirs = {one.case: one for one in rows}, {}
    for one in rows:
        if matched := MITSUBA.fullmatch(one.case):
            theirs.setdefault(matched[1], {})[int(matched[2])] = one
    return {case: [equal_error(by_case[case], found, measure) for measure in ("median", "rms")]
            for case, found in theirs.items() if case in by_case and len(found) > 1}


# ---- history -------------------------------------------------------------------------------------------------------


def records(rows: list[Row], machine: dict, date: str) -> list[dict[str, str]]:
    """One a case, in the terms of FIELDS."""
    return [{"date": date, "commit": machine["commit"], "cpu": machine["cpu"], "cores": str(machine["cores"]),
             "case": one.case, "seconds": f"{one.middle:.3f}", "error": "" if one.error is None else f"{one.error:.3g}"}
            for one in rows]


def read_history(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text)))


def history_text(history: list[dict[str, str]]) -> str:
    text = io.StringIO()
    table = csv.DictWriter(text, FIELDS, lineterminator="\n")
    table.writeheader()
    table.writerows(history)
    return text.getvalue()


def last(history: list[dict[str, str]], machine: dict) -> dict[str, dict[str, str]]:
    """The last record of each case on the same kind of machine; later ones stand below."""
    return {one["case"]: one for one in history if (one["cpu"], one["cores"]) == (machine["cpu"], str(machine["cores"]))}


# ---- Markdown ------------------------------------------------------------------------------------------------------


def markdown(rows: list[Row], machine: dict, date: str, history: list[dict[str, str]]) -> str:
    mitsuba, rounds = machine["mitsuba"], len(rows[0].seconds)
    parts = ["# Benchmarks", "",
             f"{date}, {machine['cpu']}, {machine['cores']} cores, load {machine['load']:g} before; commit"
             f" {machine['commit']}, Python {machine['python']}, POV-Ray {machine['povray']}"
             + (f", Mitsuba {mitsuba['version']} {mitsuba['variant']}." if mitsuba else "."), "",
             HOW.format(rounds=f"{rounds} rounds" if rounds != 1 else "1 round"), "",
             *_grid(["case", "seconds", "from - to", "processor", "error", "asked", "met"], [_cells(one) for one in rows]), ""]
    parts += ["## At equal error in Mitsuba 3", ""]
    if equal := equal_errors(rows):
        parts += [*_grid(["map", "error", "ours, s", "Mitsuba, s", "times as long", "paths a pixel", ""],
                         [_equal_cells(case, one, rows) for case, both in equal.items() for one in both]), ""]
        parts += [EQUALLY + (SCALAR if mitsuba and mitsuba["variant"].startswith("scalar") else ""), ""]
    elif mitsuba is None:
        parts += ["Left out: Mitsuba 3 is not installed; run: make setup-mitsuba", ""]
    else:
        parts += ["Left out: not measured.", ""]
    parts += ["## Trend", ""]
    before = last(history, machine)
    known = [one for one in rows if one.case in before]
    if known:
        parts += [*_grid(["case", "last", "seconds then", "now", "change", ""],
                         [_trend_cells(one, before[one.case]) for one in known]), ""]
    else:
        parts += ["Nothing is recorded of such a machine; `make bench-record` does.", ""]
    return "\n".join(parts)


def _cells(one: Row) -> list[str]:
    asked = ASKED.get(one.case, {})
    wanted = [f"{value:g} s" if name == "seconds" else WORDS[name].format(percent(value)) for name, value in asked.items()]
    meets = one.meets()
    return [one.case, f"{one.middle:.2f}", f"{min(one.seconds):.2f} - {max(one.seconds):.2f}", f"{one.processor:.2f}" if one.processor else "",
            ", ".join(WORDS[name].format(percent(value)) for name, value in one.errors.items()), ", ".join(wanted),
            "" if meets is None else "yes" if meets else "**no**"]


def _equal_cells(case: str, equal: Equal, rows: list[Row]) -> list[str]:
    ours = next(one for one in rows if one.case == case)
    return [case, WORDS[equal.measure].format(percent(equal.error)), f"{ours.middle:.2f}", plain(median(equal.seconds)),
            plain(equal.times), plain(equal.paths),
            f"extrapolated from {equal.paths / equal.beyond:.0f} paths" if equal.beyond > 1 else "measured between"]


def _trend_cells(one: Row, before: dict[str, str]) -> list[str]:
    then = float(before["seconds"])
    change = one.middle / then if then > 0 else float("inf")
    return [one.case, f"{before['date']} {before['commit']}", f"{then:.2f}", f"{one.middle:.2f}", f"{change - 1:+.0%}",
            "**slower**" if change > SLOWER else ""]


def percent(value: float) -> str:
    return f"{plain(100 * value, 2)} %"


def plain(value: float, digits: int = 3) -> str:
    """To so many digits, without powers of ten."""
    rounded = float(f"{value:.{digits}g}")
    return f"{rounded:,.0f}" if abs(rounded) >= 100 else f"{rounded:g}"


def _grid(head: list[str], cells: list[list[str]]) -> list[str]:
    return [f"| {' | '.join(line)} |" for line in (head, ["---"] * len(head), *cells)]
