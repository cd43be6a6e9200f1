"""Table 1: seconds of each stage, with nothing made before and for one more fog, beside the paper's."""

from __future__ import annotations

import csv
import os
import platform
import shutil
import subprocess
import time
from pathlib import Path

from pipeline.errors import InputError
from pipeline.figures import sheets
from pipeline.imaging.atomic import replacing
from pipeline.paths import PROJECT, Build
from pipeline.scene.artefacts import read_json

#: Scene and another of its fogs; seconds of Zhao et al. 2013, table 1: a person's annotation among them.
CASES = {"bathroom": "thick", "building": "thick"}
PAPER = {"bathroom": {"illumination": "30 + 10", "geometry": "30", "T and V": "20 + 35"},
         "building": {"illumination": "20", "geometry": "50", "T and V": "25 + 40"}}
PAPERS_MACHINE = "Core 2 Duo E7400 2.8 GHz, GeForce GTX 285 (2013); its seconds of illumination and geometry are a person's"
#: Which stages a row of the table adds up.
ROWS = {"photograph and camera": ("photograph", "camera"), "geometry": ("geometry",), "sun's direction": ("sun_direction",),
        "illumination": ("illumination",), "plan": ("plan", "emit"), "T and V": ("render", "decompose"),
        "composite": ("composite",)}


def measure(scenes: Path, folder: Path) -> dict[str, dict[str, dict[str, float]]]:
    """Seconds by scene, by what was there before ("cold": nothing; "warm": all but this fog; "again": all), by stage.

    "make": the whole command's. Raises InputError where a make fails.
    """
    shutil.rmtree(folder, ignore_errors=True)
    found: dict[str, dict[str, dict[str, float]]] = {}
    for scene, fog in CASES.items():
        found[scene] = {}
        for state, chosen in (("cold", None), ("warm", fog), ("again", fog)):
            start = time.monotonic()
            _make(scenes, folder, scene, chosen)
            taken = {"make": time.monotonic() - start}
            if state != "again":
                shared = {} if state == "cold" else found[scene]["cold"]
                stages = read_json(Build(scene, chosen, scenes, folder).manifest)["seconds"]["stages"]
                taken |= {name: seconds for name, seconds in stages.items() if seconds != shared.get(name)}
            found[scene][state] = taken
    return found


def _make(scenes: Path, folder: Path, scene: str, fog: str | None) -> None:
    command = ["make", "-s", f"scene={scene}", f"SCENES={scenes}", f"BUILD={folder}", *([f"fog={fog}"] if fog else [])]
    clean = {key: value for key, value in os.environ.items() if not key.startswith(("MAKE", "MFLAGS", "FOG_"))}
    done = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True, stdin=subprocess.DEVNULL, env=clean)
    if done.returncode:
        said = [line for line in done.stderr.splitlines() if line.startswith("error:")] or [f"{' '.join(command)} failed"]
        raise InputError(said[0].removeprefix("error: "), place="table 1", remedy="see its own message")


def machine() -> str:
    """Processor and cores of this one."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
        name = next(line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        name = platform.processor() or platform.machine()
    return f"{name}, {os.cpu_count()} cores"


def table(found: dict[str, dict[str, dict[str, float]]]) -> list[list[str]]:
    """Rows of text: a stage, then for each scene the paper's seconds, ours cold, and warm."""
    rows = [["seconds", *(f"{scene}, {what}" for scene in found for what in ("paper", "cold", "another fog"))]]
    for label, stages in ROWS.items():
        row = [label]
        for scene, states in found.items():
            row.append(PAPER[scene].get(label, ""))
            for state in ("cold", "warm"):
                taken = [states[state][name] for name in stages if name in states[state]]
                row.append(f"{sum(taken):.1f}" if taken else "")
        rows.append(row)
    whole = ["make in all"]
    for states in found.values():
        whole += ["", *(f"{states[state]['make']:.1f}" for state in ("cold", "warm"))]
    again = ["make once more, nothing changed"]
    for states in found.values():
        again += ["", "", f"{states['again']['make']:.1f}"]
    return [*rows, whole, again]


def draw(scenes: Path, builds: Path, path: Path) -> None:
    """Measures, and draws the table; its numbers go beside it as CSV."""
    found = measure(scenes, builds / "figures" / "timing")
    rows = table(found)
    with replacing(path.with_suffix(".csv")) as name, open(name, "w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows(rows)
    figure = sheets.pyplot().figure(figsize=(sheets.WIDTH, 0.24 * len(rows) + 0.6))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    cells = axes.table([[text.replace(", ", "\n") if k == 0 else text for text in row] for k, row in enumerate(rows)],
                       bbox=(0.005, 0.22, 0.99, 0.77), cellLoc="right", colWidths=[0.28] + [0.12] * 6)
    cells.auto_set_font_size(False)
    cells.set_fontsize(7)
    for (row, column), cell in cells.get_celld().items():
        cell.set_linewidth(0.4)
        if column == 0:
            cell.set_text_props(ha="left")
        if row == 0:
            cell.set_height(cell.get_height() * 1.6)
    figure.text(0.01, 0.08, f"paper: {PAPERS_MACHINE}\nours: {machine()}; nobody's seconds are in it", size=6, va="center")
    sheets.save(figure, path)
