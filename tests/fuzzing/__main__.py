"""Runs cases and counts how they ended: python -m tests.fuzzing --cases 5000 --seed 1."""

from __future__ import annotations

import argparse
import os
import re
import shutil
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from tests.fuzzing.cases import KINDS, Case, case_of, keep
from tests.fuzzing.judge import judged

#: One line of progress each so many cases.
EVERY = 500


def main(arguments: list[str] | None = None) -> int:
    """1 where a case failed."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzzing", description=__doc__)
    parser.add_argument("--cases", type=int, default=2000, help="how many")
    parser.add_argument("--seed", type=int, default=1, help="of all of them")
    parser.add_argument("--kind", choices=list(KINDS), action="append", help="only these")
    parser.add_argument("--case", type=int, help="only this one, and keeps its folder")
    parser.add_argument("--keep", type=Path, default=Path("build/fuzzing"), help="where failing cases are written down")
    options = parser.parse_args(arguments)
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    kinds = options.kind or list(KINDS)
    if options.case is not None:
        case = case_of(options.seed, options.case, kinds)
        folder = (options.keep / f"{case.seed}-{case.number}").resolve()
        found = judged(case, folder / "run")
        print(f"{case.told}; fog {case.fog}; {folder / 'run'}\n{found.get('traceback', '')}{found}")
        return int(found["outcome"] == "failed")
    outcomes, refusals, failures, longest = fuzz(range(options.cases), options.seed, kinds, options.keep)
    print(f"{options.cases} cases, seed {options.seed}: " + ", ".join(f"{n} {o}" for o, n in sorted(outcomes.items())))
    print(f"longest {longest[0]:.1f} s (case {longest[1]})")
    print("refused:")
    for what, count in refusals.most_common():
        print(f"  {count:6} {what}")
    print("failed:" if failures else "none failed")
    for what, numbers in sorted(failures.items(), key=lambda item: -len(item[1])):
        print(f"  {len(numbers):6} {what}; run again with --case {numbers[0]}")
    return int(bool(failures))


def fuzz(numbers, seed: int, kinds: list[str], keep_in: Path
         ) -> tuple[Counter, Counter, dict[str, list[int]], tuple[float, int]]:
    """Outcomes, refusals by kind, failing cases by kind, and the longest."""
    outcomes: Counter[str] = Counter()
    refusals: Counter[str] = Counter()
    failures: dict[str, list[int]] = {}
    longest = 0.0, -1
    start = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="fuzzing-") as scratch:
        folder = Path(scratch) / "case"
        for done, number in enumerate(numbers, 1):
            case = case_of(seed, number, kinds)
            found = judged(case, folder)
            outcomes[f"{found['outcome']}{' (whole chain)' if case.rendered and found['outcome'] == 'sane' else ''}"] += 1
            longest = max(longest, (found["seconds"], number))
            if found["outcome"] == "refused":
                refusals[alike(found["said"])] += 1
            elif found["outcome"] == "failed":
                what = f"{found['stage']}: {alike(found['said'])}"
                if what not in failures:
                    smallest = minimised(case, found, folder)
                    shutil.rmtree(keep_in / f"{seed}-{number}", ignore_errors=True)
                    kept = keep(smallest, found, keep_in)
                    judged(smallest, folder)
                    shutil.copytree(folder / "scenes", kept / "scenes", dirs_exist_ok=True, symlinks=True,
                                    ignore=shutil.ignore_patterns("pipe"))
                    print(f"case {number}: {what} ({smallest.told})", flush=True)
                failures.setdefault(what, []).append(number)
            if done % EVERY == 0:
                print(f"{done} cases, {time.monotonic() - start:.0f} s: {dict(outcomes)}", file=sys.stderr, flush=True)
    return outcomes, refusals, failures, longest


def minimised(case: Case, found: dict, folder: Path) -> Case:
    """The case with as few of its mutations as still end alike."""
    for step in reversed(range(len(case.steps))):
        if len(case.steps) > 1:
            fewer = case.without(step)
            again = judged(fewer, folder)
            if again["outcome"] == "failed" and again["stage"] == found["stage"]:
                case = fewer
    return case


def alike(said: str) -> str:
    """A message without the values and names in it."""
    said = re.sub(r"^error: \S*?([\w.]*)(:\d+)?(, line \d+)?: ", r"\1: ", said)
    said = re.sub(r"'[^']*'|\"[^\"]*\"", "'...'", said)
    said = re.sub(r"\[[^\]]*\]", "[...]", said)
    return re.sub(r"-?\d[\d.e+]*", "N", said)[:110]


if __name__ == "__main__":
    sys.exit(main())
