"""Stages one after the other in one process."""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, nullcontext

from pipeline.paths import Build
from pipeline.scene.artefacts import for_stage

#: Stages with a function `beforehand`, whose result `run` takes, and the last stage that it needs: it runs beside those in
#: between, which mostly wait for POV-Ray.
BESIDE = {"decompose": "plan", "composite": "plan"}


def run(build: Build, names: Sequence[str], *, done: Callable[[str, float], None],
        started: Callable[[str], AbstractContextManager] = lambda name: nullcontext()) -> None:
    """Runs the stages `names` in order; done(name, seconds) after each, the seconds [s] with those of its imports.

    started(name): holds what a stage needs while it runs.
    """
    start, begun = time.monotonic(), {}
    with ThreadPoolExecutor(1) as beside:
        for index, name in enumerate(names):
            with started(name):
                module = importlib.import_module(f"pipeline.stages.{name}")
                for later in names[index + 1:]:
                    if later in BESIDE and later not in begun and BESIDE[later] not in names[index:]:
                        other = importlib.import_module(f"pipeline.stages.{later}")
                        begun[later] = beside.submit(other.beforehand, for_stage(build, later))
                module.run(for_stage(build, name), *([begun[name].result()] if name in begun else []))
            done(name, time.monotonic() - start)
            start = time.monotonic()
