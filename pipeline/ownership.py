"""One `make` at a time in a scene's build folder, and no leftovers of one that was killed.

A chain of stages is several processes, so that no lock held by one of them covers it. The scene's `.lock`
therefore names the `make` that owns the folder for as long as it lives, and each stage holds the file
locked besides: a stage whose `make` was killed is still waited for. The system drops both by itself
whatever happens.
Stages run by hand, without `make` (FOG_MAKE), take no part.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import sys
import time
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Iterator

from pipeline.errors import InputError
from pipeline.paths import Build

POLL = 0.2  # [s]
LEFTOVERS = (".*.partial*", ".render-*")


def claim(build: Build) -> None:
    """Waits until no other `make` and no stage is at work in the scene's folder, then takes and clears it."""
    owner = os.environ.get("FOG_MAKE")
    if not owner:
        return
    me = _identity(int(owner))
    build.shared.mkdir(parents=True, exist_ok=True)
    told = False
    with _opened(build) as file:
        while True:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                file.seek(0)
                stated = file.read()
                if stated == me or not _lives(stated):
                    break
                fcntl.flock(file, fcntl.LOCK_UN)
            except BlockingIOError:
                pass
            if not told:
                print(f"waiting: another make is at work in {build.shared}", file=sys.stderr, flush=True)
                told = True
            time.sleep(POLL)
        try:
            # past the buffer, which would try again when the file is closed
            os.ftruncate(file.fileno(), 0)
            os.write(file.fileno(), me.encode())
        except OSError as error:  # a full disk's error names no file
            raise InputError(f"cannot be claimed: {error.strerror}", place=str(build.shared),
                             remedy="free some space and run again") from error
        if stated != me:
            _clear_up(build.shared)


@contextmanager
def at_work(build: Build) -> Iterator[None]:
    """Holds the scene's folder during one stage, so that nobody takes it over."""
    if not os.environ.get("FOG_MAKE") or not build.shared.is_dir():
        yield
        return
    with _opened(build) as file:
        fcntl.flock(file, fcntl.LOCK_SH)
        yield


def _opened(build: Build) -> IO[str]:
    return open(build.shared / ".lock", "a+", encoding="utf-8")


def _clear_up(folder: Path) -> None:
    """Removes what a killed stage could not: files half written, folders of renders under way."""
    for pattern in LEFTOVERS:
        for path in list(folder.rglob(pattern)):
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.unlink(missing_ok=True)


def _identity(process: int) -> str:
    """Number and start of a process: numbers are used again."""
    return f"{process} {_start(process)}"


def _start(process: int) -> str:
    """Start of a process in clock ticks since boot, "ended" for one not yet reaped, "" if unknown."""
    try:
        # proc(5): fields 3 and 22
        state, *fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
        return "ended" if state in "ZX" else fields[18]
    except OSError:
        return ""


def _lives(identity: str) -> bool:
    words = identity.split(" ")
    if len(words) != 2 or not words[0].isdecimal():
        return False
    try:
        os.kill(int(words[0]), 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        pass  # somebody else's, but there
    return _identity(int(words[0])) == identity
