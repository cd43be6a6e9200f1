"""Time against error for one scene: of every knob alone, of the plans, and of the best that a search finds."""

from __future__ import annotations

import csv
import sys
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.imaging.atomic import replacing
from pipeline.paths import Build
from pipeline.planning import trial
from pipeline.planning.calibrate import FINE, LEVELS, ROOM_DIRECTIONS, quiet
from pipeline.planning.model import calibration, concerned, demands_from_json, error_of, seconds_of
from pipeline.rendering.fineness import AREA, INTEGRATED, MIDPOINT, Fineness, as_json
from pipeline.scene.artefacts import read_json

#: Levels of the knobs that calibration leaves out.
FURTHER: dict[str, list[Any]] = {"transmittance": [MIDPOINT, INTEGRATED, AREA], "in_scattering_size": [128],
                                 "samples": [24], "shadow_lights": [5], "room_directions": ROOM_DIRECTIONS}
#: Relative errors that plans are asked for.
TOLERANCES = [0.1, 0.05, 0.02, 0.01, 0.005, 0.002]
#: What the search tries, apart from the plans.
SEARCHED: dict[str, list[Any]] = {
    "in_scattering_size": [48, 96, 192], "shadow_size": [24, 48, 96], "samples": [6, 16, 40], "shaft_samples": [8, 24, 96],
    "transmittance": [INTEGRATED, AREA], "room_directions": [32, 64, 128]}
#: Of all combinations, those that the model holds for the best are tried.
TRIED = 12
#: Pixels made as finely as it takes, to which all are compared.
PIXELS = 400
FIELDS = ["kind", "knob", "level", "seconds", "relative_error", "transmittance", "in_scattering", "expected_seconds",
          "expected_error", "on_front"]


def tradeoff(build: Build) -> list[dict[str, Any]]:
    """Makes the fog some fifty times -> rows of FIELDS, also written as tradeoff.csv and, with matplotlib, tradeoff.png."""
    rows = []
    demand = demands_from_json(read_json(build.plan)["demands"])
    # a knob of what the scene has not changes nothing
    had = {"transmittance": demand.half_shadow(MIDPOINT) > 0, "room_directions": demand.reflecting > 0,
           **{knob: concerned(demand, knob) > 0 for knob in LEVELS}}
    levels = {knob: [*LEVELS.get(knob, []), *FURTHER.get(knob, [])] for knob in {**LEVELS, **FURTHER} if had[knob]}
    first = _measured(build, "knob", "all fine", "", as_json(FINE))
    rows.append(first)
    for knob, values in levels.items():
        for value in values:
            if getattr(FINE, knob) != value:
                rows.append(_measured(build, "knob", knob, value, as_json(replace(FINE, **{knob: value}))))
        own = [row for row in rows if row["knob"] == knob]
        if all(row["relative_error"] == first["relative_error"] for row in own):
            rows = [row for row in rows if row["knob"] != knob]
    for tolerance in TOLERANCES:
        rows.append(_measured(build, "plan", "tolerance", tolerance, {"tolerance": tolerance, "budget": None}))
    for fineness in _searched(build):
        level = " ".join(f"{knob}={getattr(fineness, knob)}" for knob in SEARCHED)
        rows.append(_measured(build, "search", "several", level, as_json(fineness)))
    for row in rows:
        row["on_front"] = not any(other["seconds"] < row["seconds"] and other["relative_error"] < row["relative_error"]
                                  for other in rows)
    write(rows, build.out / "tradeoff.csv")
    return rows


def _searched(build: Build) -> list[Fineness]:
    """Combinations that the model expects on the front of time and error."""
    demand = demands_from_json(read_json(build.plan)["demands"])
    constants = calibration(build.builds)
    combined = [replace(FINE, **dict(zip(SEARCHED, values))) for values in product(*SEARCHED.values())]
    expected = sorted(((seconds_of(demand, one, constants), error_of(demand, one, constants), one) for one in combined),
                      key=lambda one: one[:2])
    front, best = [], np.inf
    for seconds, error, one in expected:
        if error < best:
            best = error
            front.append(one)
    return [front[k] for k in np.unique(np.linspace(0, len(front) - 1, min(TRIED, len(front))).round().astype(int))]


def _measured(build: Build, kind: str, knob: str, level: Any, settings: dict[str, Any]) -> dict[str, Any]:
    with quiet():
        seconds = trial.run(build, "tradeoff", {**settings, "checked_pixels": PIXELS})
        expected = read_json(trial.of(build, "tradeoff").plan)["expected"]
        error = trial.measured_error(build, "tradeoff")
    row = {"kind": kind, "knob": knob, "level": level, "seconds": sum(seconds.values()),
           **error,
           "expected_seconds": expected["seconds"], "expected_error": expected["relative_error"]}
    print(f"  {kind} {knob} {level}: {row['seconds']:.1f} s, {row['relative_error']:.2%}", file=sys.stderr, flush=True)
    return row


def write(rows: list[dict[str, Any]], path: Path) -> None:
    with replacing(path) as name, open(name, "w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, FIELDS)
        table.writeheader()
        table.writerows({**row, "seconds": f"{row['seconds']:.3f}"} for row in rows)


def draw(rows: list[dict[str, Any]], title: str, path: Path) -> None:
    """Time against error, both by powers of ten. Raises ImportError without matplotlib."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot, ticker

    figure, axes = pyplot.subplots(figsize=(7.2, 4.6), layout="constrained")
    markers = iter("osv^<>DPX*")
    floor = max(min(row["relative_error"] for row in rows if row["relative_error"] > 0) / 2, 1e-5)
    for knob in dict.fromkeys(row["knob"] for row in rows if row["kind"] == "knob" and row["knob"] != "all fine"):
        own = [row for row in rows if row["knob"] in (knob, "all fine")]
        own.sort(key=lambda row: row["seconds"])
        axes.plot([row["seconds"] for row in own], [max(row["relative_error"], floor) for row in own], next(markers) + ":",
                  markersize=4, linewidth=0.8, alpha=0.8, label=f"{knob} alone")
    found = [row for row in rows if row["kind"] == "search"]
    axes.plot([row["seconds"] for row in found], [row["relative_error"] for row in found], ".", color="0.5", label="search")
    plans = [row for row in rows if row["kind"] == "plan"]
    axes.plot([row["seconds"] for row in plans], [row["relative_error"] for row in plans], "k-s", markersize=6, label="plans")
    for row in plans:
        axes.annotate(f"{row['level']:g}", (row["seconds"], row["relative_error"]), textcoords="offset points",
                      xytext=(6, 5), fontsize=8)
    front = sorted((row for row in rows if row["on_front"]), key=lambda row: row["seconds"])
    axes.step([row["seconds"] for row in front], [max(row["relative_error"], floor) for row in front], where="post",
              color="tab:red", linewidth=1, label="Pareto front")
    axes.set(xscale="log", yscale="log", xlabel="plan to foggy photograph [s]", ylabel="relative error of the foggy photograph",
             title=title)
    for axis, form in ((axes.xaxis, "{:g}"), (axes.yaxis, "{:.3g} %")):
        factor = 100 if "%" in form else 1
        axis.set_major_locator(ticker.LogLocator(subs=(1, 2, 3, 5, 7)))
        axis.set_major_formatter(ticker.FuncFormatter(lambda value, _, form=form, factor=factor: form.format(factor * value)))
        axis.set_minor_formatter(ticker.NullFormatter())
    axes.grid(True, which="both", linewidth=0.3)
    axes.legend(fontsize=7, ncols=2)
    with replacing(path) as name:
        figure.savefig(name, dpi=130, format="png", metadata={"Software": None})
    pyplot.close(figure)
