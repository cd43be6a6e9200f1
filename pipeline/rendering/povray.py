"""Runs POV-Ray: safely, once per content, with its errors said plainly."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, as_completed
from functools import cache
from pathlib import Path

import numpy as np

from pipeline.errors import InputError
from pipeline.imaging.atomic import replacing
from pipeline.imaging.maps import read_map
from pipeline.rendering import povray_log

#: Ways in which a scene's text opens files of its own choosing. POV-Ray 3.7 confines pictures to the paths
#: that its settings permit, but neither includes nor what #fopen writes (measured with 3.7.0.10).
FILE_ACCESS = re.compile(r"\b(fopen|save_file|Parse_String|include)\b")
#: Parts of POV-Ray's library that open no files.
LIBRARY = re.compile(r'#\s*include\s*"(colors|consts|finish|functions|glass|golds|math|metals|rand|skies'
                     r'|stones|textures|transforms|woods)\.inc"')

#: With this a render ends with our thread even where we are killed outright (setpriv(1) of util-linux). Python's own way, a
#: function in the child before it becomes POV-Ray, needs a fork: that waits for numpy's threads, and they for us.
ENDS_WITH_US = ("setpriv", "--pdeathsig", "KILL")

VERSION_TIMEOUT = 60.0  # [s]
INSTALL = "install it with your system's package manager, for example: sudo apt-get install povray"

#: Warnings that were on the screen already: many runs share a template.
_SAID: set[str] = set()

#: POV-Ray processes under way, to be ended with us.
_RUNNING: set[subprocess.Popen] = set()


@cache
def program() -> str:
    named = os.environ.get("POVRAY", "povray")
    found = shutil.which(named)
    if found is None and Path(named).is_file():
        raise InputError("is no program that may be run", place=named,
                         remedy="name POV-Ray itself in POVRAY, or allow its execution")
    if found is None:
        raise InputError("POV-Ray is not installed", place=named, remedy=INSTALL)
    return found


@cache
def version() -> str:
    """Like 3.7.0.10."""
    try:
        result = subprocess.run([program(), "--version"], capture_output=True, text=True, errors="replace",
                                timeout=VERSION_TIMEOUT, stdin=subprocess.DEVNULL)
    except subprocess.TimeoutExpired:
        raise InputError(f"does not say its version within {VERSION_TIMEOUT:g} s", place=program(),
                         remedy="reinstall POV-Ray 3.7") from None
    except OSError as error:  # of another machine's kind, or no program at all
        raise InputError(f"cannot be run ({error.strerror})", place=program(),
                         remedy="reinstall POV-Ray 3.7") from None
    said = result.stdout + result.stderr
    match = re.search(r"POV-Ray (\d[\w.]*)", said)
    if not match:
        raise InputError("does not say its version", place=program(), remedy="reinstall POV-Ray 3.7")
    if not match.group(1).startswith("3.7"):
        raise InputError(f"is version {match.group(1)}", place=program(), remedy="install POV-Ray 3.7")
    formats = re.search(r"image formats:(.*)", said)
    if formats and "openexr" not in formats.group(1).lower():
        raise InputError("was built without OpenEXR", place=program(),
                         remedy="install a POV-Ray 3.7 that lists openexr in `povray --version`")
    return match.group(1)


def render(pov: Path, image: Path, width: int, height: int, *, threads: int | None = None,
           timeout: float = 1800.0) -> float:
    """Renders `pov` into the float EXR `image` unless that is there for the same text; seconds it took.

    The EXR appears whole or not at all; beside it stand the log and the hash of what made it.
    Raises InputError with POV-Ray's own error line, the template it comes from and the log's name.
    """
    stamp = image.with_suffix(".sha256")
    text = pov.read_bytes()
    _refuse_file_access(text.decode(errors="replace"), pov)
    digest = hashlib.sha256(text + f"{width}x{height} {version()}".encode()).hexdigest()
    if _is_done(image, stamp, digest):
        return 0.0
    image.parent.mkdir(parents=True, exist_ok=True)
    stamp.unlink(missing_ok=True)
    start = time.monotonic()
    with tempfile.TemporaryDirectory(prefix=".render-", dir=image.parent) as folder:
        partial = Path(folder) / "image.exr"
        try:
            home = _confined_home(Path(folder), pov)
        except OSError as error:  # a full disk's error names no file
            raise InputError(f"cannot be rendered: {error.strerror}", place=str(image),
                             remedy="check that its folder is writable and has space left") from error
        # POV-Ray changes into the file's folder itself; absolute names keep it independent of ours
        # side files are looked for beside the scene by +L only
        command = [program(), f"+I{pov.resolve()}", f"+L{pov.parent.resolve()}",
                   f"+O{partial.resolve()}", "+FE",
                   f"+W{width}", f"+H{height}", "-A", "-D", "-P", "-C",
                   *([f"+WT{threads}"] if threads else [])]
        log = _run(command, home, pov, image, timeout)
        with replacing(image.with_suffix(".log")) as name:
            name.write_text("command: " + " ".join(command) + "\n" + log)
        try:
            pixels = read_map(partial)
        except InputError as error:
            raise InputError(f"POV-Ray wrote no readable picture for {pov.name}", place=str(pov),
                             remedy=f"see {image.with_suffix('.log')}; is the disk full?") from error
        if not np.isfinite(pixels).all():
            raise InputError(f"{int((~np.isfinite(pixels)).sum())} values of the render are not finite",
                             place=str(pov),
                             remedy="bound every ray (Fog_Backdrop) and check densities and light sizes")
        if pixels.shape[:2] != (height, width):
            raise InputError(f"render has {pixels.shape[1]}x{pixels.shape[0]} pixels, not {width}x{height}",
                             place=str(pov), remedy="leave the picture's size to the command line")
        os.replace(partial, image)
    for warning in povray_log.warnings(log, pov):
        if warning not in _SAID:
            _SAID.add(warning)
            print(f"warning: {warning}", file=sys.stderr, flush=True)
    seconds = time.monotonic() - start
    with replacing(stamp) as name:
        name.write_text(f"{digest} {seconds:.3f} {image.stat().st_size}\n")
    return seconds


def _is_done(image: Path, stamp: Path, digest: str) -> bool:
    """Whether the picture is that of this text, and as long as it was: a machine that went down may have cut it."""
    if not image.exists() or not stamp.exists():
        return False
    words = stamp.read_text(encoding="utf-8", errors="replace").split()
    return words[:1] == [digest] and words[2:] == [str(image.stat().st_size)]


#: Renders under way at once. POV-Ray waits for its own threads for 0.7 s a render, in which others may work.
MOST_AT_ONCE = 16


def render_together(jobs: list[tuple[Path, Path, int, int]], *, threads: int | None, timeout: float,
                    told: Callable[[int, float], None]) -> list[float]:
    """`render` of several (pov, image, width, height), on all cores, or with `threads` in all; seconds each took."""
    if threads is None:
        return render_side_by_side(jobs, threads=os.cpu_count() or 1, at_once=MOST_AT_ONCE, timeout=timeout, told=told)
    return render_side_by_side(jobs, at_once=threads, timeout=timeout, told=told)


def render_side_by_side(jobs: list[tuple[Path, Path, int, int]], *, threads: int | None = None,
                        at_once: int | None = None, timeout: float = 1800.0,
                        told: Callable[[int, float], None] | None = None) -> list[float]:
    """`render` of several (pov, image, width, height), `at_once` of them; seconds each took.

    One thread each where not stated. POV-Ray's radiosity gathers its samples in the order in which its threads come by:
    on several, no two renders are alike. told(index, seconds): called as each ends, by the caller's own thread:
    what two threads print at once comes out as one line.
    """
    with ThreadPoolExecutor(max(1, at_once or os.cpu_count() or 1)) as pool:
        started = {pool.submit(render, *job, threads=threads or 1, timeout=timeout): index
                   for index, job in enumerate(jobs)}
        try:
            # the first that fails ends the others
            for done in as_completed(started):
                seconds = done.result()
                if told:
                    told(started[done], seconds)
            return [one.result() for one in started]
        except BaseException:
            for future in started:
                future.cancel()
            for process in list(_RUNNING):
                _kill(process)
            raise


def _refuse_file_access(text: str, pov: Path) -> None:
    """Scenes are passed on, templates and all: they may not read or overwrite a person's files."""
    # in comments too: POV-Ray nests them, and a parser that saw them differently could be led past
    found = FILE_ACCESS.search(LIBRARY.sub(lambda m: " " * len(m.group()), text))
    if found:
        line = text.count("\n", 0, found.start()) + 1
        raise InputError(f"'{found.group()}' lets the scene open files",
                         remedy="write the contents into the template, or use <% include %>; of POV-Ray's"
                         " library, #include \"colors.inc\" and the like are allowed",
                         place=povray_log.template_place(text.splitlines(), line) or f"{pov}:{line}")


def _run(command: list[str], home: Path, pov: Path, image: Path, timeout: float) -> str:
    environment = {**os.environ, "HOME": str(home)}
    environment.pop("DISPLAY", None)
    process = subprocess.Popen([*_tied(), *command], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                               stderr=subprocess.STDOUT,
                               env=environment, cwd=home, start_new_session=True, text=True, errors="replace")
    _RUNNING.add(process)
    try:
        log, _ = process.communicate(timeout=timeout)
    except subprocess.TimeoutExpired:
        _kill(process)
        raise InputError(f"POV-Ray took longer than {timeout:g} s on {pov.name}", place=str(pov),
                         remedy="lower samples or sub_lights, or raise render.timeout") from None
    except BaseException:
        _kill(process)
        raise
    finally:
        _RUNNING.discard(process)
    if process.returncode == 0 and not povray_log.was_stopped(log):
        return log
    log_file = image.with_suffix(".log")
    with replacing(log_file) as name:
        name.write_text("command: " + " ".join(command) + "\n" + log)
    raise povray_log.failure(log, pov, log_file, process.returncode)


@cache
def _tied() -> tuple[str, ...]:
    """What to begin a command with, so that it ends with us; nothing where the system has no such program."""
    try:
        works = subprocess.run([*ENDS_WITH_US, "true"], capture_output=True, timeout=VERSION_TIMEOUT, stdin=subprocess.DEVNULL)
    except (OSError, subprocess.TimeoutExpired):
        return ()
    return ENDS_WITH_US if works.returncode == 0 else ()


def _kill(process: subprocess.Popen) -> None:
    try:
        os.killpg(process.pid, signal.SIGKILL)
    except ProcessLookupError:
        pass
    process.wait()


def warnings_beside(image: Path, pov: Path) -> list[str]:
    """Warnings of the render that made `image`, by the log that stands beside it."""
    log = image.with_suffix(".log")
    return povray_log.warnings(log.read_text(errors="replace"), pov) if log.exists() else []


def _confined_home(folder: Path, pov: Path) -> Path:
    """A home whose POV-Ray configuration keeps pictures to their folder; the person's own stays out."""
    settings = folder / ".povray" / "3.7"
    settings.mkdir(parents=True)
    (settings / "povray.conf").write_text(
        "[File I/O Security]\nrestricted\n[Shellout Security]\nforbidden\n[Permitted Paths]\n"
        f'read = "{pov.parent.resolve()}"\nread = "/usr/share/povray-3.7"\n'
        f'read+write = "{folder.resolve()}"\n')
    return folder
