"""Seconds and errors of the maps, of whole fogs and of Mitsuba 3: `make bench`; `make bench-record` keeps them.

    python -m tests.benchmarks [--repeats 5] [--only cornell] [--folder build/bench] [--record]

writes bench.md and bench.json into the folder; --record also adds to history.csv beside this file and writes results.md
anew. All cases take turns in each round, in an order of its own, so that a slow minute hits all alike. What was not asked
for by its name is not measured: --only V measures what has a V in its name.
"""

from __future__ import annotations

import argparse
import random
import sys
from collections import defaultdict
from dataclasses import asdict
from datetime import date
from pathlib import Path

from pipeline.errors import InputError
from pipeline.imaging.atomic import replacing
from pipeline.scene.artefacts import write_json
from tests.benchmarks import cases, machine, table

HERE = Path(__file__).parent
HISTORY, RESULTS = HERE / "history.csv", HERE / "results.md"


def run(folder: Path, repeats: int, only: str, record: bool) -> None:
    if repeats < 1:
        raise InputError(f"repeats={repeats}", place="command line", remedy="give a number from 1 on")
    if record and only:
        raise InputError(f"--record with --only {only}", place="command line", remedy="record all cases, or none")
    on = machine.described()
    works = cases.works(folder, on["mitsuba"], only)
    if not works:
        raise InputError(f"--only {only} leaves no case", place="command line", remedy="leave it out to see all names")
    measured = defaultdict(list)
    for number in range(1, repeats + 1):
        order = list(works)
        random.Random(number).shuffle(order)
        for name in order:
            for case, one in works[name](number).items():
                measured[case].append(one)
                print(f"round {number}/{repeats}: {case}: {one.seconds:.2f} s", file=sys.stderr, flush=True)
    names = sorted(measured, key=lambda case: next(k for k, name in enumerate(works) if case.split(",")[0] == name))
    rows, today = [table.row(case, measured[case]) for case in names], date.today().isoformat()
    history = table.read_history(HISTORY.read_text(encoding="utf-8")) if HISTORY.exists() else []
    text = table.markdown(rows, on, today, history)
    _write(folder / "bench.md", text)
    write_json(folder / "bench.json", {
        "date": today, "machine": on, "rows": [asdict(one) for one in rows],
        "equal_error": {case: [asdict(one) for one in both] for case, both in table.equal_errors(rows).items()}})
    print(text)
    if record:
        _write(RESULTS, text)
        _write(HISTORY, table.history_text(history + table.records(rows, on, today)))


def _write(path: Path, text: str) -> None:
    with replacing(path) as name:
        name.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    options = argparse.ArgumentParser(prog="tests.benchmarks", description=__doc__.splitlines()[0])
    options.add_argument("--folder", type=Path, default=Path("build") / "bench")
    options.add_argument("--repeats", type=int, default=5)
    options.add_argument("--only", default="", help="part of the names of what is measured")
    options.add_argument("--record", action="store_true", help="also into the files that the project carries")
    given = options.parse_args()
    try:
        run(given.folder, given.repeats, given.only, given.record)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
