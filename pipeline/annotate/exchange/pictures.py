"""Which picture of a file that describes several is the scene's photograph."""

from __future__ import annotations

from pathlib import PurePosixPath
from typing import Hashable, TypeVar

from pipeline.errors import InputError

Key = TypeVar("Key", bound=Hashable)


def chosen(names: dict[Key, str], wanted: list[str]) -> Key:
    """The key of the only picture, or of the one called as one of `wanted`, with or without its ending.

    Raises InputError, naming the pictures, where that is none or several.
    """
    if len(names) == 1:
        return next(iter(names))
    called = {key: PurePosixPath(name.replace("\\", "/")) for key, name in names.items()}
    for one in wanted:
        for same in (lambda path: path.name == one, lambda path: path.stem == PurePosixPath(one).stem):
            found = [key for key, path in called.items() if same(path)]
            if len(found) == 1:
                return found[0]
    listed = ", ".join(list(names.values())[:5]) + (", ..." if len(names) > 5 else "")
    raise InputError(f"{len(names)} pictures, and which is the scene's photograph is not clear",
                     remedy=f"say which: --image NAME, one of {listed}")
