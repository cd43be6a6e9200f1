"""`annotations`: a file from another program into a scene, or a scene's annotations into a file."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

from pipeline.annotate.written.document import SceneDocument
from pipeline.annotate.exchange import fspy_files, labelme
from pipeline.annotate.exchange.exporting import drawings_of
from pipeline.annotate.exchange.importing import import_file
from pipeline.errors import InputError
from pipeline.imaging.atomic import replacing
from pipeline.imaging.photograph_reading import read_size
from pipeline.paths import Build, inside
from pipeline.scene.artefacts import read_camera
from pipeline.scene.load import checked, parsed

EXPORTS = ("labelme", "fspy")


def imported(build: Build, file: str, *, replace: bool = False, image: str = "") -> None:
    """Imports `file` into the scene and saves it; says what came of every part. Raises InputError."""
    document = SceneDocument.open(build.scene_file)
    size = _size(build, document)
    if size is None:
        print("note: the photograph is not in the scene's folder: sizes go unchecked", file=sys.stderr)
    for line in import_file(document, _path(file), size, replace=replace, image=image):
        print(line)
    document.save()
    try:
        checked(parsed(build.scene_file, document.text), {}, None)
    except InputError as error:
        print(f"note: the scene is not complete yet: {error}", file=sys.stderr)
    print(f"done: {build.scene_file}")


def exported(build: Build, file: str, to: str, *, replace: bool = False) -> None:
    """Writes the scene's annotations, or for fSpy its camera as build/ has it, into `file`. Raises InputError."""
    to = to or EXPORTS[0]
    if to not in EXPORTS:
        raise InputError(f"to={to} is no format of annotations", place="command line", remedy=f"use one of {', '.join(EXPORTS)}")
    path = _path(file)
    if path.is_dir() or not path.parent.is_dir():
        raise InputError("is a folder" if path.is_dir() else "its folder does not exist", place=str(path),
                         remedy="name a file in a folder that exists")
    if os.path.lexists(path) and not replace:
        raise InputError("the file exists already", place=str(path), remedy="name another, or allow it to be replaced (replace=yes)")
    document = SceneDocument.open(build.scene_file)
    if to == "fspy":
        if not build.camera.exists():
            raise InputError("the scene's camera is not worked out yet", place=str(build.camera),
                             remedy=f"run make {build.camera} scene={build.scene}")
        content = fspy_files.exported(read_camera(build))
        said = ["exported: camera"]
    else:
        found = drawings_of(document.data, _size(build, document))
        if not found.drawn:
            raise InputError("nothing in it is marked in the photograph", place=str(build.scene_file), remedy="annotate it first")
        picture = document.get(("photograph", "file"))
        content = labelme.written(found, os.path.relpath(build.source / picture, path.parent))
        said = [f"exported: {one.label}" for one in found.drawn] + [f"left out: {line}" for line in found.left_out]
    text = json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    with replacing(path) as partial:
        partial.write_text(text, encoding="utf-8")
    print("\n".join([*said, f"done: {path}"]))


def _path(file: str) -> Path:
    if not file or not file.isprintable():
        raise InputError("no file of annotations is named" if not file else f"no file can be called '{file}' here",
                         place="command line", remedy="say which: file=annotations.json")
    return Path(file)


def _size(build: Build, document: SceneDocument) -> tuple[int, int] | None:
    """Width and height of the photograph, upright [pixel]; None where it is not there."""
    file = document.get(("photograph", "file"))
    if not isinstance(file, str):
        return None
    path = inside(build, file)
    return read_size(path) if path.is_file() else None
