"""Runs a case in a process of its own, and judges how it ended."""

from __future__ import annotations

import contextlib
import importlib
import io
import json
import os
import re
import resource
import select
import shutil
import signal
import time
import traceback
import warnings
from pathlib import Path

from pipeline.cli import STAGES, main
from pipeline.scene.model import scene_model
from tests.fuzzing.cases import SCENE, SECRET, Case, write

#: Longest and largest that a case may be, far beyond what sound ones take. Time is of the processor, which other work on
#: the machine does not lengthen; one that waits without end is stopped after so many times as long by the clock.
SECONDS, RENDERED_SECONDS = 60.0, 300.0
WAITING = 5
MEMORY = 4 * 2**30
FILE = 256 * 2**20
LONGEST_MESSAGE = 1200
#: Everything before POV-Ray, and the whole chain.
CHEAP = ("resolve", "photograph", "camera", "geometry", "sun_direction", "illumination", "plan", "emit")
WHOLE = (*CHEAP, "render", "decompose", "composite")
#: So many rays a side tell whether the fog is sane along them.
RAYS = 8


#: Loaded once, in the process that cases are forked from.
scene_model()
MODULES = {stage: importlib.import_module(f"pipeline.stages.{stage}") for stage in STAGES}


class Insane(Exception):
    """Results that cannot be."""


def judged(case: Case, folder: Path) -> dict:
    """outcome: refused | sane | failed, with what was said, and seconds of the processor; runs in a child, in `folder`."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    read, write_end = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(read)
        _child(case, folder, write_end)  # never returns
    os.close(write_end)
    start, limit = time.monotonic(), RENDERED_SECONDS if case.rendered else SECONDS
    answer = b""
    with os.fdopen(read, "rb", buffering=0) as pipe:
        while time.monotonic() - start < WAITING * limit:
            if select.select([pipe], [], [], 0.5)[0]:
                piece = pipe.read(65536)
                if not piece:
                    break
                answer += piece
        else:
            os.kill(child, signal.SIGKILL)
    _, status, used = os.wait4(child, 0)
    seconds = used.ru_utime + used.ru_stime
    if seconds >= limit or time.monotonic() - start >= WAITING * limit:
        found = {"outcome": "failed", "said": f"longer than {limit:g} s", "stage": _stage(folder)}
    elif not answer:
        found = {"outcome": "failed", "said": f"ended by status {status}, no word", "stage": _stage(folder)}
    else:
        found = json.loads(answer)
    return {**found, "seconds": seconds}


def _stage(folder: Path) -> str:
    path = folder / "elsewhere" / "stage"
    return path.read_text() if path.exists() else "before the first stage"


def _child(case: Case, folder: Path, write_end: int) -> None:
    try:
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        resource.setrlimit(resource.RLIMIT_CPU, [int(RENDERED_SECONDS if case.rendered else SECONDS) + 1] * 2)
        resource.setrlimit(resource.RLIMIT_FSIZE, (FILE, FILE))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        null = os.open(os.devnull, os.O_RDWR)
        for stream in (0, 1, 2):
            os.dup2(null, stream)
        try:
            found = run(case, folder)
        except BaseException as error:
            last = traceback.extract_tb(error.__traceback__)
            ours = [f for f in last if "/pipeline/" in f.filename] or last
            found = {"outcome": "failed", "said": f"{type(error).__name__}: {error}"[:500],
                     "stage": f"{Path(ours[-1].filename).name}:{ours[-1].name}",
                     "traceback": traceback.format_exc()[-4000:]}
        os.write(write_end, json.dumps(found).encode())
    finally:
        os._exit(0)


def run(case: Case, root: Path) -> dict:
    """The case in this process. Raises whatever no stage may raise, and Insane."""
    overrides = write(case, root)
    elsewhere = root / "elsewhere"
    os.chdir(elsewhere)
    for name in ("FOG_SCENE", "FOG_NAME", "FOG_OVERRIDES", "FOG_SCENES", "FOG_BUILD", "FOG_MAKE"):
        os.environ.pop(name, None)
    before = _listed(root)
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        found = _staged(case, root, overrides)
        if found["outcome"] == "sane":
            _check_results(case, root)
    (elsewhere / "stage").unlink(missing_ok=True)
    after = _listed(root)
    if after != before:
        raise Insane(f"changed outside the build folder: {sorted(set(after.items()) ^ set(before.items()))[:4]}")
    for path in (root / "build").rglob("*") if (root / "build").exists() else ():
        if path.is_symlink() or path.is_file() and SECRET.encode() in path.read_bytes():
            raise Insane(f"{path} leads or comes from outside the scene's folder")
    return found


def _listed(root: Path) -> dict[str, tuple]:
    """Everything beside the build folder, with size and time of the last change."""
    return {str(path.relative_to(root)): (path.lstat().st_size, path.lstat().st_mtime_ns if not path.is_dir() else 0)
            for path in root.rglob("*") if path.relative_to(root).parts[0] != "build" and path.name != "stage"}


def _staged(case: Case, root: Path, overrides: dict[str, str]) -> dict:
    if not case.rendered:
        _without_renders()
    options = ["--scene", SCENE, "--scenes", str(root / "scenes"), "--build", str(root / "build"),
               *(["--fog", case.fog] if case.fog and case.kind != "grid" else [])]
    sets = [word for key, value in overrides.items() for word in ("--set", f"{key}={value}")]
    for stage in WHOLE if case.rendered else CHEAP:
        (root / "elsewhere" / "stage").write_text(stage)
        said = io.StringIO()
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
            status = main([stage, *options, *(sets if stage == "resolve" else [])])
        if status:
            return {"outcome": "refused", "stage": stage, "said": _checked_message(said.getvalue(), status)}
    return {"outcome": "sane", "stage": "", "said": ""}


def _checked_message(text: str, status: int) -> str:
    """The refusal's one line, which tells place, problem and remedy."""
    lines = [line for line in text.rstrip("\n").split("\n") if not line.startswith("  ")]
    errors = [line for line in lines if line.startswith("error: ")]
    if status != 2 or len(errors) != 1 or lines[-1] != errors[0]:
        raise Insane(f"status {status}, not one line at the end: {text[-300:]!r}")
    line = errors[0]
    if "Traceback" in line or "; " not in line or len(line) > LONGEST_MESSAGE or not line.isprintable():
        raise Insane(f"{len(line)} characters, traceback, no remedy or not printable: {line[:300]!r}")
    if not re.match(r"error: [^ ].*?: ", line):
        raise Insane(f"no place: {line[:300]!r}")
    return line


def _without_renders() -> None:
    """Estimates that POV-Ray makes are taken as 1: the .pov files are written, and not rendered."""
    illumination = MODULES["illumination"]
    illumination.render = lambda *_: None

    def stand_in(build, scene, settings, given, templates):
        from numpy import full

        found = {name: {"strength": [1.0, 1.0, 1.0], "source": "stand-in"} for name in scene.lights if name not in given}
        return full((1, 1, 3), 0.5), {}, found, {"estimator": "stand-in", "messages": []}
    illumination._by_separation = stand_in


def _check_results(case: Case, root: Path) -> None:
    import numpy as np

    from pipeline.imaging.maps import read_map
    from pipeline.paths import Build
    from pipeline.scene.artefacts import read_fog, read_json, read_placed, read_strengths

    build = Build(SCENE, case.fog if case.kind != "grid" else None, root / "scenes", root / "build")
    scene, medium = read_placed(build), read_fog(build)
    camera = scene.camera
    depth, photograph = np.squeeze(read_map(build.depth), -1) if read_map(build.depth).ndim == 3 else read_map(
        build.depth), read_map(build.photograph)
    _true(depth.shape == (camera.height, camera.width) == photograph.shape[:2], "sizes differ")
    _true(np.isfinite(depth).all() and (depth >= 0).all(), "depth is not finite or below 0")
    _true(np.isfinite(photograph).all(), "photograph is not finite")
    turn = camera.world_from_camera
    _true(np.abs(turn @ turn.T - np.eye(3)).max() < 1e-6 and camera.focal_length > 0, "no camera")
    for path in build.shared.rglob("*.json"):
        _true(not re.search(r"\b(NaN|Infinity)\b", re.sub(r'"(\\.|[^"\\])*"', "", path.read_text()))
              or path.name in ("fog.json", "fogs.json"), f"{path.name} holds NaN or Infinity")
    for path in build.pov.glob("*.pov"):
        code = re.sub(r"//.*|\"[^\"\n]*\"", "", path.read_text())
        _true(not re.search(r"(?<![\w.])(nan|inf)(?![\w.])", code), f"{path.name} holds nan or inf")
    rows = np.linspace(0, camera.height - 1, min(RAYS, camera.height)).astype(int)
    columns = np.linspace(0, camera.width - 1, min(RAYS, camera.width)).astype(int)
    directions, depth = camera.directions(camera.pixel_centres()[rows][:, columns]), depth[rows][:, columns].astype(float)
    optical = medium.optical_depth(camera.position, camera.position + depth[..., None] * directions)
    _true(not np.isnan(optical).any() and (optical >= -1e-9).all(), "optical depth is NaN or below 0")
    strengths = read_strengths(build) if not medium.is_clear() else {}
    for name, light in scene.lights.items():
        if medium.is_clear() or scene.rendered(name):
            continue
        glow = light.in_scattering(medium, camera.position, directions, depth) * strengths[name]
        _true(np.isfinite(glow).all() and (glow >= -1e-6 * max(float(np.abs(glow).max()), 1e-30)).all(),
              f"V of {name} is not finite or below 0")
    if case.rendered:
        through = read_map(build.transmittance) if build.transmittance.exists() else np.ones(1)
        glow = read_map(build.in_scattering()) if build.in_scattering().exists() else np.zeros(1)
        _true(np.isfinite(through).all() and (through >= 0).all() and (through <= 1 + 1e-4).all(), "T is not in 0..1")
        _true(np.isfinite(glow).all() and (glow >= 0).all(), "V is not finite or below 0")
        _true(np.isfinite(read_map(build.foggy(".exr"))).all(), "the foggy photograph is not finite")
        _true(read_json(build.plan)["fog_is_clear"] == medium.is_clear(), "plan and fog differ")


def _true(is_so: bool, otherwise: str) -> None:
    if not is_so:
        raise Insane(otherwise)
