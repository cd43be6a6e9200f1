"""A slice of the fuzzer's cases (`make fuzz` runs thousands), and that it would find what it looks for."""

from __future__ import annotations

import multiprocessing
import os
from concurrent.futures import ProcessPoolExecutor

import pytest

from pipeline.errors import InputError
from tests.fuzzing import judge
from tests.fuzzing.__main__ import alike, fuzz
from tests.fuzzing.cases import KINDS, Case, case_of, write

CASES = 28


def test_only_refusals_and_sane_results(tmp_path):
    # in a process of its own: cases are forked, and a library whose threads other tests began would wait for them there
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        outcomes, refusals, failures, _ = pool.submit(fuzz, range(1, CASES + 1), 11, list(KINDS), tmp_path).result()
    assert not failures, failures
    # a fuzzer of which all is refused at once, or nothing, would test little
    assert outcomes["refused"] > CASES / 4 and outcomes["sane"] > CASES / 20 and len(refusals) > 10, outcomes


def test_cases_are_told_by_seed_and_number(tmp_path):
    first, again = case_of(3, 14, list(KINDS)), case_of(3, 14, list(KINDS))
    assert first == again and first != case_of(3, 15, list(KINDS))
    for name in ("a", "b"):
        write(first, tmp_path / name)
    assert [(tmp_path / name / "scenes/hostile/scene.yaml").read_bytes() for name in "ab"].count(
        (tmp_path / "a/scenes/hostile/scene.yaml").read_bytes()) == 2


@pytest.mark.parametrize("fault, says", [
    (lambda case, root: 1 / 0, "ZeroDivisionError"),
    (lambda case, root: os._exit(3), "no word"),
    (lambda case, root: bytearray(2**40), "MemoryError"),
    (lambda case, root: [None for _ in iter(int, 1)], "longer than"),
])
def test_faults_are_found(fault, says, tmp_path, monkeypatch):
    monkeypatch.setattr(judge, "run", fault)
    monkeypatch.setattr(judge, "SECONDS", 1.0)
    monkeypatch.setattr(judge, "MEMORY", 2**40) if says == "longer than" else None
    found = judge.judged(Case(0, 1, "text", "bathroom", (), None, False), tmp_path / "case")
    assert found["outcome"] == "failed" and says in found["said"]


@pytest.mark.parametrize("text", ["error: no place and no remedy\n", "Traceback\nerror: a: b; c\nmore\n", "error: a: b\n",
                                  "error: a: \x1b[31m b; c\n", "error: a: " + "x" * 2000 + "; c\n"])
def test_poor_messages_are_found(text):
    with pytest.raises(judge.Insane):
        judge._checked_message(text, 2)


def test_alike_messages_are_counted_together():
    said = [f"error: {InputError(f'has {n} pixels', remedy='make it smaller', place=f'/tmp/{n}/scene.yaml:{n}')}"
            for n in (3, 41)]
    assert alike(said[0]) == alike(said[1]) == "scene.yaml: has N pixels; make it smaller"
