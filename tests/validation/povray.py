"""Plain POV-Ray for the project's own models."""

from __future__ import annotations

import subprocess
from pathlib import Path

from pipeline.errors import InputError
from pipeline.rendering.povray import program


def povray(model: Path, image: Path, width: int, height: int, *options: str) -> None:
    """Renders `model` into the half-float EXR `image`. One thread: POV-Ray's radiosity is not repeatable on several.

    Raises InputError with POV-Ray's own complaint.
    """
    image.unlink(missing_ok=True)
    done = subprocess.run([program(), f"+I{model.name}", f"+O{image}", "+FE", f"+W{width}", f"+H{height}", "-A", "-D", "-GR",
                           "-GS", "+WT1", *options], cwd=model.parent, capture_output=True, text=True, errors="replace",
                          stdin=subprocess.DEVNULL)
    if done.returncode or not image.exists():
        errors = [line for line in done.stderr.splitlines() if "rror" in line or line.startswith("File ")]
        raise InputError(f"POV-Ray failed: {' '.join(errors) or done.stderr[-400:]}", remedy="mend the model", place=str(model))
