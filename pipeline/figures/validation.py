"""Fig. 10: curves of the error that the validation measured."""

from __future__ import annotations

import csv
import re
from pathlib import Path

from pipeline.errors import InputError
from pipeline.figures import sheets

FOG = re.compile(r"(homogeneous|height)_a([\d.]+)_d([\d.]+)")
SHOWN = {"default": "as made by default", "best": "finest settings", "midpoint T": "T by the lamp's midpoint",
         "exact but midpoint T": "exact but midpoint T", "exact but midpoint V": "exact but midpoint V"}


def error_curves(scenes: Path, builds: Path, path: Path) -> None:
    """From build/validation/mse.csv, one row a fog."""
    file = builds / "validation" / "mse.csv"
    if not file.is_file():
        raise InputError("was not made", place=str(file), remedy="run make validation")
    with open(file, newline="", encoding="utf-8") as table:
        rows = list(csv.DictReader(table))
    fogs = []
    for row in rows:
        kind, absorption, scattering = FOG.fullmatch(row["fog"]).groups()
        fogs.append((kind, float(absorption), float(scattering), row))
    even = [fog for fog in fogs if fog[0] == "homogeneous"]
    panels = []
    for label, chosen, x in (
            ("absorption [1/m], scattering 0.1/m", [f for f in even if f[2] == 0.1], lambda f: f[1]),
            ("scattering [1/m], absorption 0.05/m", [f for f in even if f[1] == 0.05], lambda f: f[2]),
            ("height fog: extinction below [1/m]", [f for f in fogs if f[0] == "height"], lambda f: f[1] + f[2])):
        chosen = sorted(chosen, key=x)
        names = [name for name in SHOWN if all(name in row for *_, row in chosen)]
        panels.append((label, [x(f) for f in chosen],
                       {SHOWN[name]: [float(row[name]) for *_, row in chosen] for name in names}))
    sheets.curves(path, panels, "mean square error")
