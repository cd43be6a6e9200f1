"""Answer files as the page saves them, checked as what strangers send: sizes, types, bounds, and whether they belong here.

One file is one participant. A file that is no good is left out with one line that says where and what to do; the others
count. Nothing of a file is shown but what a narrow pattern allows, and names of files without what a terminal would obey.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from pipeline.errors import InputError
from pipeline.study.description import PHOTOGRAPH, TRUTH, Study

#: What a file calls itself; the version counts up when a field gets another meaning.
ANSWERS, VERSION = "fog-study-answers", 1
#: Bytes of a file and files of a folder: a hundred times what a study needs.
MAX_BYTES, MAX_FILES = 1_000_000, 10_000
#: Milliseconds by which a page may be late in noticing that the time is over.
LATE = 1000
#: Of participants that no person is behind.
SIMULATED = "SIM-"

Side = Literal["A", "B"]
Milliseconds = Annotated[int, Field(ge=0, le=10**9)]
Pixels = Annotated[list[Annotated[int, Field(ge=0, le=100_000)]], Field(min_length=2, max_length=2)]
Count = Annotated[int, Field(ge=0, le=100_000)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class Trial(_Strict):
    """What one person saw and answered."""

    order: Annotated[int, Field(ge=1, le=1000)]
    practice: bool
    stimulus: Annotated[str, Field(max_length=40)]
    scene: Annotated[str, Field(max_length=80)]
    fog: Annotated[str, Field(max_length=40)]
    density: Annotated[str, Field(max_length=60)]
    true_is: Literal[PHOTOGRAPH, TRUTH]
    true_side: Side
    answer: Side | None
    timed_out: bool
    milliseconds: Milliseconds
    hidden_milliseconds: Milliseconds
    times_hidden: Count
    reloads: Count
    viewport: Pixels
    shown: Pixels
    pixel_ratio: Annotated[float, Field(ge=0, le=100, allow_inf_nan=False)]

    @property
    def right(self) -> bool:
        """Whether the real photograph, or the rendered truth, was picked."""
        return self.answer == self.true_side


class Answers(_Strict):
    """One participant's file."""

    format: Literal[ANSWERS]
    version: Literal[VERSION]
    study: Annotated[str, Field(pattern=r"^[0-9a-f]{16}$")]
    page: Annotated[str, Field(pattern=r"^[0-9a-f]{16}$")]
    participant: Annotated[str, Field(pattern=r"^(SIM-[0-9]{1,6}|[A-Z2-9]{4}-[A-Z2-9]{4})$")]
    seconds_allowed: Annotated[float, Field(ge=1, le=600)]
    trials: Annotated[list[Trial], Field(max_length=200)]

    @property
    def counted(self) -> list[Trial]:
        return [one for one in self.trials if not one.practice]


@dataclass(frozen=True)
class Collected:
    """Participants whose answers count, and what was left out, one line each."""

    participants: list[Answers]
    left_out: list[str]


def collect(folder: Path, study: Study) -> Collected:
    """All *.json files of a folder. Raises InputError if there is no such folder, or none of its files is good."""
    if not folder.is_dir():
        raise InputError("no such folder", place=named(folder), remedy="name the one with the answer files: make study-results answers=FOLDER")
    paths = sorted(path for path in folder.iterdir() if path.suffix.lower() == ".json")
    if len(paths) > MAX_FILES:
        raise InputError(f"{len(paths)} answer files", place=named(folder), remedy=f"keep at most {MAX_FILES} in a folder")
    participants: list[Answers] = []
    left_out: list[str] = []
    places: dict[str, Path] = {}
    for path in paths:
        try:
            one = read_answers(path, study)
            _new(one, path, participants, places)
            participants.append(one)
            places[one.participant] = path
        except InputError as error:
            left_out.append(str(error))
    if left_out and not participants:
        more = f" (and {len(left_out) - 1} more)" if len(left_out) > 1 else ""
        raise InputError(f"none of {len(paths)} answer files can be used; {left_out[0]}{more}", place=named(folder),
                         remedy="mend or remove them")
    return Collected(participants, left_out)


def read_answers(path: Path, study: Study) -> Answers:
    """One checked file. Raises InputError with file, place, value and what to do."""
    answers = checked(_parsed(path), study, named(path))
    if answers.participant.startswith(SIMULATED):
        raise InputError(f"participant {answers.participant} is simulated", place=named(path), remedy="remove it: only people count")
    return answers


def checked(value: Any, study: Study, place: str) -> Answers:
    """Answers of the study from parsed JSON."""
    if not isinstance(value, dict) or value.get("format") != ANSWERS:
        raise InputError("is no answer file of a study", place=place, remedy="remove it from the folder")
    if value.get("version") != VERSION:
        raise InputError(f"version = {_short(value.get('version'))}", place=place,
                         remedy=f"this pipeline reads version {VERSION}; use the one that made the page")
    try:
        answers = Answers.model_validate(value)
    except ValidationError as error:
        raise _complaint(error, place) from None
    if answers.study != study.digest:
        raise InputError(f"answers another study, {answers.study}, than {study.path}, {study.digest}", place=place,
                         remedy="name the description it belongs to, as it was then: study=FILE, or remove it")
    if answers.seconds_allowed != study.seconds:
        raise InputError(f"seconds_allowed = {answers.seconds_allowed:g}, the study's are {study.seconds:g}", place=place,
                         remedy="it was changed after it was saved; remove it")
    known = {one.name: one for one in study.stimuli}
    for number, (trial, order) in enumerate(zip(answers.trials, range(1, len(answers.trials) + 1))):
        wrong = _wrong(trial, order, known, [one.stimulus for one in answers.trials[:number]], study)
        if wrong:
            raise InputError(f"trials[{number}].{wrong}", place=place, remedy="it was changed after it was saved; remove it")
    return answers


def _wrong(trial: Trial, order: int, known: dict, before: Iterable[str], study: Study) -> str | None:
    """What of a trial cannot be, or None."""
    stimulus = known.get(trial.stimulus)
    if stimulus is None:
        return f"stimulus = {_short(trial.stimulus)} is none of the study"
    if trial.stimulus in before:
        return f"stimulus = {_short(trial.stimulus)} was answered before"
    if trial.order != order:
        return f"order = {trial.order}, it is number {order}"
    told = {"practice": stimulus.practice, "scene": stimulus.build.scene, "fog": stimulus.fog, "true_is": stimulus.kind}
    for key, value in told.items():
        if getattr(trial, key) != value:
            return f"{key} = {_short(getattr(trial, key))}, in the study it is {_short(value)}"
    if trial.timed_out != (trial.answer is None):
        return f"timed_out = {str(trial.timed_out).lower()} with answer = {_short(trial.answer)}"
    if trial.milliseconds > 1000 * study.seconds + LATE:
        return f"milliseconds = {trial.milliseconds}, more than was allowed"
    return None


def _new(one: Answers, path: Path, participants: list[Answers], places: dict[str, Path]) -> None:
    """Raises InputError for a participant who is there already."""
    if one.participant not in places:
        return
    other = places[one.participant]
    same = next(known for known in participants if known.participant == one.participant) == one
    what = "is a copy of" if same else "differs from"
    remedy = "remove one of the two" if same else f"ask which is right and remove the other; {named(other)} was counted"
    raise InputError(f"participant {one.participant} {what} {named(other)}", place=named(path), remedy=remedy)


def _parsed(path: Path) -> Any:
    try:
        if path.is_symlink() or not path.is_file():
            raise InputError("is no plain file", place=named(path), remedy="put the file itself there")
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise InputError(f"has {size} bytes", place=named(path), remedy=f"an answer file is below {MAX_BYTES} bytes; remove it")
        return json.loads(path.read_bytes().decode("utf-8"), parse_constant=_no_number)
    except json.JSONDecodeError as error:
        raise InputError(f"is no JSON ({error.msg})", place=f"{named(path)}:{error.lineno}",
                         remedy="save it again from the page, or remove it") from None
    except (OSError, ValueError, RecursionError) as error:
        said = "nested too deeply" if isinstance(error, RecursionError) else str(error)[:100]
        raise InputError(f"cannot be read ({said})", place=named(path), remedy="save it again from the page, or remove it") from None


def _no_number(text: str) -> None:
    raise ValueError(f"{text} is no number")


def _complaint(error: ValidationError, place: str) -> InputError:
    found = error.errors(include_url=False)
    where = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in found[0]["loc"]).lstrip(".")
    more = f" (and {len(found) - 1} more)" if len(found) > 1 else ""
    # of a missing or unknown key the value is the whole group
    value = "" if found[0]["type"] in ("missing", "extra_forbidden") else f" = {_short(found[0]['input'])}"
    return InputError(f"{where[:80]}{value}: {found[0]['msg'][:120]}{more}", place=place,
                      remedy="save it again from the page, or remove it")


def _short(value: Any) -> str:
    try:
        text = json.dumps(value)
    except ValueError:
        text = "?"
    return text if len(text) <= 40 else text[:37] + "..."


def named(path: Path) -> str:
    """A path as it may be shown: without line breaks and what a terminal would obey, and not endless."""
    text = "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in str(path))
    return text if len(text) <= 200 else f"{text[:60]} ... {text[-130:]}"
