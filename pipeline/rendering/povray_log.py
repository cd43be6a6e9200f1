"""What POV-Ray said in its log, traced back to the templates: its warnings, and why it failed."""

from __future__ import annotations

import re
import signal
from dataclasses import dataclass
from pathlib import Path

from pipeline import paths
from pipeline.errors import InputError

#: POV-Ray breaks its lines here, in the middle of a word where that is longer (measured with 3.7.0.10).
WIDTH = 80
#: Warnings that say nothing about a scene, by their beginning, with the reason.
HARMLESS = {"Should have at least 2 objects in csg": "a shape that casts no shadow stands in a union by itself",
            "This rendering uses the following experimental feature(s): mesh camera": "single pixels are rendered by one"}
#: More than these are counted, not told: a loop of a template may warn at every turn.
MOST_WARNINGS = 20

_PLACE = r"File '(?P<file>[^']*)' line (?P<line>\d+): "
_MESSAGE = re.compile(rf"(?:{_PLACE})?(?P<kind>(?:Possible )?[A-Z][a-z]+ (?:Warning|Error)): (?P<text>.*)")
#: Warnings that come after the render stand below their place.
_PLACE_ABOVE = re.compile(r"File: (?P<file>.*?)  Line: (?P<line>\d+)")

#: What it says of a signal that it heeds; where that comes late, it ends well all the same.
_STOPPED = re.compile(r"^povray: received signal .*requested render cancel|^Render cancelled by user", re.M)
#: What POV-Ray says where its own files cannot be written on.
NO_SPACE = "Cannot access data in file"
NO_MEMORY = ("std::bad_alloc", "Out of memory")


@dataclass(frozen=True)
class Message:
    """One warning or error of POV-Ray; `line` is that of the `.pov` file, if it names one."""

    kind: str
    text: str
    line: int | None

    @property
    def is_warning(self) -> bool:
        """Whether a render may go on; some possible errors end it, and are then told as its reason."""
        return self.kind.endswith("Warning") or self.kind.startswith("Possible")


def messages(log: str) -> list[Message]:
    """All warnings and errors in a log, whatever its line breaks fell on."""
    found: list[Message] = []
    above = None
    for line in _unbroken(log):
        place = _PLACE_ABOVE.fullmatch(line)
        match = _MESSAGE.match(line)
        if match:
            number = match["line"] or (above["line"] if above else None)
            found.append(Message(match["kind"], _plain(match["text"]), int(number) if number else None))
        above = place
    return found


def warnings(log: str, pov: Path) -> list[str]:
    """Each warning once, with the template's line, without the harmless ones."""
    emitted = pov.read_text(encoding="utf-8", errors="replace").splitlines() if pov.exists() else []
    told: dict[str, None] = {}
    for one in messages(log):
        if one.is_warning and not one.text.startswith(tuple(HARMLESS)):
            told[f"{place_of(emitted, one.line, pov) or pov}: POV-Ray: {one.text}"] = None
    more = len(told) - MOST_WARNINGS
    return [*list(told)[:MOST_WARNINGS], *([f"{pov.name}: {more} more warnings of POV-Ray are in its log"] if more > 0 else [])]


def was_stopped(log: str) -> bool:
    """Whether somebody told POV-Ray to stop."""
    return bool(_STOPPED.search(log))


def failure(log: str, pov: Path, log_file: Path, status: int) -> InputError:
    """Why POV-Ray ended with this status, negative for a signal: its own error, its template's line, what to do."""
    see = f"see {log_file}, which begins with the command"
    number = -status if status < 0 else status - 128  # a shell between us and it tells a signal so
    name = next((one.name for one in signal.Signals if one == number), None)
    if NO_SPACE in log or name == "SIGXFSZ":
        return InputError(f"POV-Ray could not write the picture of {pov.name}: no space left", place=str(log_file.parent),
                          remedy="free some space and run again")
    if any(words in log for words in NO_MEMORY):
        return InputError(f"POV-Ray ran out of memory on {pov.name}", place=_error_place(log, pov),
                          remedy=f"lower render.threads or use a smaller photograph; {see}")
    if name:
        remedy = {"SIGKILL": "run again, and what is finished is kept; where nobody ended it, memory ran out: lower"
                             " render.threads or use a smaller photograph",
                  "SIGSEGV": "a crash at the very end is a known fault of function densities at scene level; see"
                             f" {log_file}"}.get(name, f"run again, and what is finished is kept; {see}")
        return InputError(f"POV-Ray was ended by signal {name}", place=str(pov), remedy=remedy)
    if was_stopped(log):
        return InputError("POV-Ray was told to stop", place=str(pov),
                          remedy="run again, and what is finished is kept")
    errors = [one for one in messages(log) if not one.kind.endswith("Warning")]
    if errors:
        # the last: what came before it did not end the render
        one = errors[-1]
        said = f"{one.text} ({pov}:{one.line})" if one.line else one.text
        return InputError(f"POV-Ray: {said}", place=_error_place(log, pov),
                          remedy=f"mend this line of the template; {see}")
    lines = [line for line in log.splitlines() if "error" in line.lower()] or log.strip().splitlines()[-1:]
    return InputError(f"POV-Ray failed: {_plain(lines[0]) if lines else 'it said nothing'}", place=str(pov), remedy=see)


def place_of(emitted: list[str], line: int | None, pov: Path) -> str | None:
    """FILE:LINE of the template for a line of a `.pov` file, of that file itself where no template is known."""
    return None if line is None else template_place(emitted, line) or f"{pov}:{line}"


def template_place(emitted: list[str], line: int) -> str | None:
    """FILE:LINE of the template that a line of a `.pov` file was written from, by its marker and text."""
    marker = re.compile(r"^\s*// ---- (\S+)$")
    if not emitted:
        return None
    wanted = emitted[min(line, len(emitted)) - 1].strip()
    candidates: list[str] = []
    for text in reversed(emitted[:line]):
        found = marker.match(text)
        if found and found.group(1) not in candidates:
            candidates.append(found.group(1))
    for name in candidates:
        path = Path(name) if Path(name).is_absolute() else paths.PROJECT / name
        if not path.is_file():
            path = Path(name)
        if path.is_file():
            for number, text in enumerate(path.read_text(errors="replace").splitlines(), 1):
                if text.strip() == wanted and wanted:
                    return f"{name}:{number}"
    return candidates[0] if candidates else None


def _error_place(log: str, pov: Path) -> str:
    lines = [one.line for one in messages(log) if one.line and not one.kind.endswith("Warning")]
    emitted = pov.read_text(encoding="utf-8", errors="replace").splitlines()
    return place_of(emitted, lines[-1] if lines else None, pov) or str(pov)


def _unbroken(log: str) -> list[str]:
    """The log's lines as they were before POV-Ray broke them: after a space, which begins the next line, or in a word."""
    lines: list[str] = []
    full = False
    for line in log.splitlines():
        message = bool(lines) and bool(lines[-1].startswith("File '") or _MESSAGE.match(lines[-1]))
        if message and line.startswith(" "):
            lines[-1] += line
        elif message and full and not line.startswith("File '"):
            lines[-1] += line
        else:
            lines.append(line)
        full = len(line) == WIDTH
    return lines


def _plain(text: str) -> str:
    """One line without what steers a terminal: a scene's own words are in it."""
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())
