"""A scene file as a document that a page and an editor may change in turn.

What a person wrote stays: an edit changes the values that it means, and no comment, blank line or quote beside them.
"""

from __future__ import annotations

import copy
import fcntl
import hashlib
import os
import re
import shutil
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Iterator

from pipeline.annotate.written.edits import edited, unchanged
from pipeline.annotate.written.yaml_text import count, numbers, plain, readable
from pipeline.errors import InputError, nearest
from pipeline.imaging.atomic import replacing
from pipeline.scene.fog_entry import FOG_NAME
from pipeline.scene.load import FIXED, MAX_BYTES, MAX_DEPTH, MAX_NODES, composed, content_of, unit_at
from pipeline.scene.model import scene_model

#: Characters of all states together that undo goes back to; the oldest are forgotten first, one is always kept.
MAX_HISTORY = 20_000_000
#: States of which the values are kept, too, so that going back and forth by a few is quick.
KNOWN_STATES = 8
THING = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,39}")
#: Groups of things that a person names, by the keys round them; * is any name.
NAMED = (("shapes",), ("lights",), ("fogs",), ("depth", "regions"), ("lights", "*", "openings"))


class Changed(InputError):
    """The scene file is no longer what was opened or last saved: somebody else wrote it."""


class SceneDocument:
    """The scene file at `path`, with all that stands in it, and the states that it had before.

    Places are keys and indices from the top of the file, such as ("lights", "lamp", "outline", "pixels", 0). Numbers are
    written to 0.01 pixel or six digits, and `data` holds them as they are written. The file need not describe a whole
    scene, but is always YAML of the kind that the loader reads. Not for several threads at once.
    """

    def __init__(self, path: Path, text: str):
        self.path = Path(path)
        self._past: list[str] = []
        self._future: list[str] = []
        self._depth = 0
        self._read: dict[str, tuple] = {}
        self._take(text)
        self._saved = text
        self._digest = _digest(text.encode("utf-8"))

    @classmethod
    def open(cls, path: Path) -> SceneDocument:
        """Raises InputError as the loader does: not there, too large, no YAML of plain values."""
        return cls(path, content_of(Path(path)))

    @property
    def data(self) -> dict[str, Any]:
        """The whole scene as plain dicts, lists, numbers and texts: a copy."""
        return copy.deepcopy(self._values)

    @property
    def text(self) -> str:
        """What would be saved."""
        return self._text

    @property
    def changed(self) -> bool:
        """Whether there is something to save."""
        return self._text != self._saved

    @property
    def can_undo(self) -> bool:
        return bool(self._past)

    @property
    def can_redo(self) -> bool:
        return bool(self._future)

    def get(self, place: tuple, default: Any = None) -> Any:
        """A copy of the value at `place`, or `default` where nothing is."""
        node = self._values
        for key in place:
            if not _holds(node, key):
                return default
            node = node[key]
        return copy.deepcopy(node)

    # ---- changes
    def set(self, place: tuple, value: Any) -> None:
        """Writes a value, and the groups round it that are missing; an index one past a list's end adds to it.

        In a group or list that is there only what differs is written. One undo step, and none where nothing differs.
        Raises InputError for a place that cannot be, and for what no scene file can hold.
        """
        place, value = tuple(place), plain(value)
        if not place:
            if not isinstance(value, dict) or not value:
                raise self._mistake(place, "the scene is a group of 'name: value' lines", "give a group with something in it")
            self._change(value, place)
            return
        if len(place) > MAX_DEPTH:
            raise self._mistake(place[:3], f"{len(place)} keys deep, more than {MAX_DEPTH}", FIXED)
        plain(value, len(place))
        wanted = self.data
        node = wanted
        for key, following in zip(place[:-1], place[1:]):
            self._enterable(node, key, place)
            missing = isinstance(node, list) and key == len(node)
            if missing:
                node.append(None)
            if (node.get(key) if isinstance(node, dict) else node[key]) is None:
                node[key] = {} if isinstance(following, str) else []
            node = node[key]
        self._enterable(node, place[-1], place)
        if isinstance(node, list) and place[-1] == len(node):
            node.append(value)
        else:
            node[place[-1]] = value
        self._change(wanted, place)

    def remove(self, place: tuple) -> None:
        """Removes a value, and the groups and lists round it that are empty then; nothing where nothing is. One undo step."""
        place, nothing = tuple(place), object()
        if self.get(place, nothing) is nothing:
            return
        while len(place) > 1 and len(self.get(place[:-1])) == 1:
            place = place[:-1]
        if not place or len(place) == 1 and len(self._values) == 1:
            raise self._mistake((), "nothing would be left of the scene", "keep at least the photograph")
        wanted = self.data
        node = wanted
        for key in place[:-1]:
            node = node[key]
        del node[place[-1]]
        self._change(wanted, place[:-1])

    def rename(self, place: tuple, name: str) -> None:
        """Gives a shape, light, region, fog or opening another name; what lies on a shape or region follows. One undo step.

        Raises InputError for a name that is taken or none, and for a place that has no name of a person's own.
        """
        place = tuple(place)
        if self.get(place) is None or not _is_named(place):
            raise self._mistake(place, "nothing here has a name of its own",
                                "rename a shape, light, region, fog or opening that is there")
        group, old = place[:-1], place[-1]
        if name == old:
            return
        right = FOG_NAME.fullmatch(name) and len(name) <= 40 if group == ("fogs",) else THING.fullmatch(name)
        if not isinstance(name, str) or not right:
            raise self._mistake(place, f"'{name}' is no name", "use letters, digits, '_' and '-', beginning with a letter,"
                                " 40 at most")
        siblings = self.get(group)
        if name in siblings:
            raise self._mistake(place, f"'{name}' is there already", "give another name")
        node = next(key for key, _ in self._node(group).value if key.value == old)
        text = self._text[:node.start_mark.index] + name + self._text[node.end_mark.index:]
        renamed = {name if key == old else key: value for key, value in siblings.items()}
        wanted = _with(self._values, group, renamed)
        with self.step():
            self._replace(text, wanted, place)
            if group in (("shapes",), ("depth", "regions")):
                self._change(_following(self.data, old, name, faces=group == ("shapes",)), ())

    @contextmanager
    def step(self) -> Iterator[None]:
        """All changes within are one undo step; an exception takes them back."""
        before, past = self._text, len(self._past)
        self._depth += 1
        try:
            yield
        except BaseException:
            self._take(before)
            raise
        finally:
            self._depth -= 1
            if self._depth == 0 and self._text != before:
                del self._past[past:]
                self._remember(before)

    def undo(self) -> bool:
        """Goes back by one step; False where there is none."""
        return self._go(self._past, self._future)

    def redo(self) -> bool:
        """Goes forward again by one step; False where there is none."""
        return self._go(self._future, self._past)

    # ---- the file
    def save(self, overwrite: bool = False) -> None:
        """Writes the file, whole or not at all; a link stays one.

        Raises Changed, and leaves the file as it is, when it is no longer what was opened or last saved, unless
        `overwrite`; InputError when it cannot be written. Two documents never save over one another unseen.
        """
        target, content = self.path.resolve(), self._text.encode("utf-8")
        try:
            folder = os.open(target.parent, os.O_RDONLY)
        except OSError as error:
            raise InputError(f"cannot write the file: {error.strerror}", place=str(self.path),
                             remedy="check that its folder exists and is writable") from error
        try:
            fcntl.flock(folder, fcntl.LOCK_EX)
            there = self._on_disk()
            if there != _digest(content):
                if there != self._digest and not overwrite:
                    said = "was removed" if there is None else "was changed by somebody else"
                    raise Changed(f"the file {said} since it was opened or saved", place=str(self.path),
                                  remedy="load it again, or save over it")
                with replacing(target) as partial:
                    with open(partial, "wb") as file:
                        file.write(content)
                        file.flush()
                        os.fsync(file.fileno())
                    if there is not None:
                        shutil.copymode(target, partial)
        finally:
            os.close(folder)
        self._saved, self._digest = self._text, _digest(content)

    def reload(self) -> None:
        """Takes what is on the disk now, as a step that can be undone. Raises InputError as `open` does."""
        text = content_of(self.path)
        with self.step():
            self._take(text)
        self._saved, self._digest = text, _digest(text.encode("utf-8"))

    def changed_on_disk(self) -> bool:
        """Whether the file is no longer what was opened or last saved."""
        return self._on_disk() != self._digest

    def _on_disk(self) -> str | None:
        try:
            with open(self.path, "rb") as file:
                return _digest(file.read(MAX_BYTES + 1))
        except FileNotFoundError:
            return None
        except OSError as error:
            raise InputError(f"cannot be read ({error.strerror})", place=str(self.path),
                             remedy="check that it is a file and may be read") from error

    # ---- states
    def _take(self, text: str) -> None:
        """Makes the text the present state; of the last few it is known what they say."""
        known = self._read.pop(text, None)
        if known is None:
            root, read = composed(self.path, text)
            known = root, read.values
        self._read[text] = known
        while len(self._read) > KNOWN_STATES:
            del self._read[next(iter(self._read))]
        self._root, self._values = known
        self._text = text

    def _remember(self, text: str) -> None:
        self._past.append(text)
        self._future.clear()
        while len(self._past) > 1 and sum(map(len, self._past)) > MAX_HISTORY:
            del self._past[0]

    def _go(self, there: list[str], here: list[str]) -> bool:
        if not there:
            return False
        here.append(self._text)
        self._take(there.pop())
        return True

    def _change(self, wanted: dict[str, Any], place: tuple) -> None:
        """To the values `wanted`, which differ from those that are there at `place` or round it."""
        if unchanged(self._values, wanted):
            return
        if count(wanted) > MAX_NODES:
            raise self._mistake(place, f"the scene would hold more than {MAX_NODES} values", FIXED)
        model, units = scene_model(), {}

        def unit_of(where: tuple) -> str:
            while isinstance(where[-1], int):
                where = where[:-1]
            if where not in units:
                units[where] = unit_at(model, wanted, where)
            return units[where]

        wanted = readable(wanted, (), unit_of, numbers(self._values))
        if unchanged(self._values, wanted):
            return
        plain_text = self._text.replace("\r\n", "\n")
        root = self._root if plain_text == self._text else composed(self.path, plain_text)[0]
        for end in [None, *range(len(place), 0, -1)]:  # as little as will do; else in one piece, with ever more round it
            whole = None if end is None else place[:end]
            try:
                text = edited(plain_text, root, self._values, wanted, list(model.model_fields), whole)
                if plain_text != self._text:
                    text = text.replace("\n", "\r\n")
                self._replace(text, wanted, place)
                return
            except (_NotAsWanted, ValueError, IndexError):
                continue
        raise self._mistake(place, "cannot be changed without changing what stands beside it", "change it in an editor")

    def _replace(self, text: str, wanted: dict[str, Any], place: tuple) -> None:
        """Takes a text that has to hold the values `wanted`."""
        if len(text.encode("utf-8")) > MAX_BYTES:
            raise self._mistake(place, f"the scene file would be larger than {MAX_BYTES} bytes", FIXED)
        before = self._text
        try:
            self._take(text)
        except InputError as error:
            self._take(before)
            raise _NotAsWanted(str(error)) from None
        if not unchanged(self._values, wanted):
            self._take(before)
            raise _NotAsWanted("other values")
        if self._depth == 0:
            self._remember(before)

    # ---- places
    def _node(self, place: tuple):
        node = self._root
        for key in place:
            node = node.value[key] if isinstance(key, int) else next(v for k, v in node.value if k.value == key)
        return node

    def _enterable(self, node: Any, key: Any, place: tuple) -> None:
        """Raises InputError where `key` can be no key of a group or index of a list."""
        if isinstance(node, dict) and isinstance(key, str):
            return
        if isinstance(node, list) and isinstance(key, int) and not isinstance(key, bool) and 0 <= key <= len(node):
            return
        if isinstance(node, list):
            raise self._mistake(place, f"no entry {key!r} in a list of {len(node)}", f"count from 0 to {len(node)}")
        what = "a group" if isinstance(node, dict) else "a value"
        names = list(node) if isinstance(node, dict) else []
        raise self._mistake(place, f"{what} has no entry {key!r}", "go by the names in the scene file" + nearest(str(key), names))

    def _mistake(self, place: tuple, problem: str, remedy: str) -> InputError:
        dotted = ".".join(map(str, place))
        return InputError(f"{dotted}: {problem}" if dotted else problem, place=str(self.path), remedy=remedy)


class _NotAsWanted(Exception):
    """A changed text does not hold what it was to hold."""


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _holds(node: Any, key: Any) -> bool:
    if isinstance(node, dict):
        return isinstance(key, str) and key in node
    return isinstance(node, list) and isinstance(key, int) and not isinstance(key, bool) and 0 <= key < len(node)


def _is_named(place: tuple) -> bool:
    return any(len(place) == len(group) + 1 and all(want in ("*", key) for want, key in zip(group, place))
               for group in NAMED)


def _with(values: dict[str, Any], place: tuple, new: Any) -> dict[str, Any]:
    """A copy of the values with another one at `place`."""
    if not place:
        return new
    return {**values, place[0]: _with(values[place[0]], place[1:], new)}


def _following(value: Any, old: str, new: str, *, faces: bool) -> Any:
    """The values with `on` and `stands_on` led to a thing's new name; faces: by NAME.FACE, else by NAME."""
    if isinstance(value, list):
        return [_following(one, old, new, faces=faces) for one in value]
    if not isinstance(value, dict):
        return value
    result = {}
    for key, one in value.items():
        if key in ("on", "stands_on") and isinstance(one, str):
            name, dot, face = one.partition(".")
            result[key] = new + dot + face if name == old and bool(dot) == faces else one
        else:
            result[key] = _following(one, old, new, faces=faces)
    return result
