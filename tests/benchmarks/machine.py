"""What a benchmark ran on, and of which version of the project."""

from __future__ import annotations

import importlib.util
import os
import platform
import subprocess
from importlib import metadata
from pathlib import Path

from pipeline.paths import PROJECT
from pipeline.rendering import povray, second_opinion


def described() -> dict[str, object]:
    """cpu and cores tell machines apart; load: processes that ran or waited in the minute before."""
    return {"cpu": _cpu(), "cores": os.cpu_count() or 1, "load": round(os.getloadavg()[0], 1), "commit": _commit(),
            "python": platform.python_version(), "povray": povray.version(), "mitsuba": _mitsuba()}


def _cpu() -> str:
    try:
        stated = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        stated = ""
    models = [line.partition(":")[2].strip() for line in stated.splitlines() if line.startswith("model name")]
    return (models or [platform.processor() or platform.machine()])[0]


def _commit() -> str:
    """Short name, with a + where files differ from it."""
    def said(*words: str) -> str:
        return subprocess.run(["git", *words], cwd=PROJECT, capture_output=True, text=True, check=True).stdout.strip()

    try:
        return said("rev-parse", "--short", "HEAD") + ("+" if said("status", "--porcelain", "--untracked-files=no") else "")
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def _mitsuba() -> dict[str, str] | None:
    """Its version and the fastest of its variants that works here, None where it is not installed."""
    if importlib.util.find_spec("mitsuba") is None:
        return None
    works = second_opinion._vectorised()
    return {"version": metadata.version("mitsuba"), "variant": second_opinion.FAST if works else second_opinion.SAFE}
