"""Files that appear whole or not at all."""

from __future__ import annotations

import errno
import os
import uuid
from contextlib import contextmanager
from pathlib import Path
from typing import Iterator

from pipeline.errors import InputError

NO_SPACE = (errno.ENOSPC, errno.EDQUOT)


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary name beside `path` that takes its place when the block ends well.

    The temporary name keeps the suffix, by which image libraries pick a format. Whatever goes wrong,
    nothing is left behind and an older file at `path` stays as it was. An `OSError` in the block
    (disk full, folder missing or not writable) becomes an `InputError`.
    """
    path = Path(path)
    partial = path.with_name(f".{path.stem}.{uuid.uuid4().hex[:8]}.partial{path.suffix}")
    try:
        yield partial
        os.replace(partial, path)
    except OSError as error:
        remedy = ("free some space and run again" if error.errno in NO_SPACE
                  else "check that its folder exists, is writable and has space left")
        raise InputError(f"cannot write the file: {error.strerror or error}", remedy=remedy,
                         place=str(path)) from error
    finally:
        partial.unlink(missing_ok=True)


def write_error(path: Path, size: int, said: str) -> OSError:
    """Why a library could not write `size` bytes to `path`: a full disk, which it does not tell apart, or what it said."""
    disk = os.statvfs(path.parent)
    full = disk.f_bavail * disk.f_frsize < size
    return OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)) if full else OSError(said)
