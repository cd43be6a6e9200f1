"""Stages one after the other in one process."""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, nullcontext

from pipeline.paths import Build
from pipeline.scene.artefacts import for_stage


def run(build: Build, names: Sequence[str], *, done: Callable[[str, float], None],
        started: Callable[[str], AbstractContextManager] = lambda name: nullcontext()) -> None:
    """Runs the stages `names` in order; done(name, seconds) after each, the seconds [s] with those of its imports.

    A stage may have a function `beforehand`, for what needs nothing of the stage before it: that runs beside this one,
    which mostly waits for POV-Ray, and the stage's own `run` takes what it returned. started(name): holds what a stage
    needs while it runs.
    """
    start, ready = time.monotonic(), ()
    with ThreadPoolExecutor(1) as beside:
        for name, following in zip(names, [*names[1:], None]):
            with started(name):
                module = importlib.import_module(f"pipeline.stages.{name}")
                arguments = [future.result() for future in ready]
                ready = ()
                if following and hasattr(after := importlib.import_module(f"pipeline.stages.{following}"), "beforehand"):
                    ready = (beside.submit(after.beforehand, for_stage(build, following)),)
                module.run(for_stage(build, name), *arguments)
            done(name, time.monotonic() - start)
            start = time.monotonic()
