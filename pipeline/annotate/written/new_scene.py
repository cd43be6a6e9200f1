"""A new scene's folder: the photograph, and a first scene file to draw into."""

from __future__ import annotations

import os
import shutil
import uuid
from pathlib import Path

from pipeline.errors import InputError
from pipeline.imaging.atomic import NO_SPACE
from pipeline.imaging.photograph_file import SUFFIXES, Photograph
from pipeline.imaging.photograph_reading import read, read_exif_focal_length
from pipeline.paths import checked_name

#: What a phone's main lens sees across a photograph, roughly [degree].
USUAL_ANGLE = 65

FIRST = """\
# yaml-language-server: $schema=../scene.schema.json
#
# {width} x {height} pixels. Pixels are [u, v] from the photograph's top-left corner: u to the right, v down. Lengths are metres.
# To be drawn: for the camera lines along edges (x runs left-right, y vertically, z front-back), or in the open air the horizon;
# a room and what stands in it (shapes), or regions of the open air (depth); lamps, windows and their sun, or the sky (lights).

photograph:
  file: {file}

camera:
  height: 1.6                       # m above the floor or ground, a guess; it sets the scale of everything
{lens}

lights:
  reflected: {{type: ambient}}        # what walls, floor or ground throw back

fog:
  type: homogeneous
  visibility: 20                    # m at which contrast falls to 5 %; smaller is denser
"""


def new_scene(scenes: Path, name: str, photo: Path) -> Path:
    """Makes `scenes`/NAME with a copy of the photograph and a first scene file, and returns the file's path.

    The photograph is read whole, with the limits of every photograph. The folder appears whole or not at all, and nothing
    that is there is touched. Raises InputError for a name that a scene may not have or that is taken, and for whatever is no
    photograph.
    """
    checked_name(name, "scene")
    scenes, photo = Path(scenes), Path(photo)
    folder = scenes / name
    if os.path.lexists(folder):
        raise InputError(f"'{name}' is there already", place=str(folder),
                         remedy=f"give another name, or annotate it: scene={name} without a photograph")
    if photo.exists() and not photo.is_file() and not photo.is_dir():
        raise InputError("is no plain file", place=str(photo), remedy="give the photograph's own path")
    if "\0" in str(photo):
        raise InputError("is no file's name", place="command line", remedy="give the photograph's own path")
    partial = scenes / f".{name}.{uuid.uuid4().hex[:8]}.partial"
    try:
        photograph = read(photo)
        scenes.mkdir(parents=True, exist_ok=True)
        partial.mkdir()
        copy = partial / f"photograph{_suffix(photo, photograph)}"
        shutil.copyfile(photo, copy)
        if copy.stat().st_size != photo.stat().st_size:
            raise InputError("was changed while it was copied", place=str(photo), remedy="try again")
        text = FIRST.format(width=photograph.width, height=photograph.height, file=copy.name, lens=_lens(photo))
        (partial / "scene.yaml").write_text(text, encoding="utf-8")
        if os.path.lexists(folder):
            raise InputError(f"'{name}' is there already", place=str(folder), remedy="give another name")
        os.rename(partial, folder)
    except OSError as error:
        remedy = "free some space and run again" if error.errno in NO_SPACE else "check that it can be written"
        raise InputError(f"cannot make the scene: {error.strerror or error}", place=str(folder), remedy=remedy) from error
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return folder / "scene.yaml"


def _suffix(photo: Path, photograph: Photograph) -> str:
    """The photograph's own ending where it fits what it holds."""
    own = photo.suffix.lower()
    return own if own in SUFFIXES[photograph.format] else photograph.suffix


def _lens(photo: Path) -> str:
    focal = read_exif_focal_length(photo)
    if focal:
        return f"  # the lens is known by the photograph: {focal:.4g} mm on a 35 mm camera"
    return f"  horizontal_field_of_view: {USUAL_ANGLE:<7} # degrees, a guess: lines along two axes tell it better"
