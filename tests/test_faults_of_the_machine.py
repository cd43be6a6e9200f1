"""A full disk, folders that may not be written, locks of the dead, and builds of an older version."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.imaging import photograph as photographs
from pipeline.imaging import photograph_writing
from pipeline.imaging.maps import read_map, write_map
from pipeline.scene.artefacts import FORMAT, read_json, write_json
from tests.test_make import Made, fresh, original, rendered, scene, stages  # noqa: F401: fixtures

PROJECT = Path(__file__).resolve().parent.parent
NOBODY = 65534


@contextmanager
def mounted(folder: Path, kilobytes: int):
    """A file system of its own in memory, as small as wanted."""
    folder.mkdir()
    done = subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={kilobytes}k", "tmpfs", str(folder)],
                          capture_output=True, text=True)
    if done.returncode:
        pytest.skip(f"no file system may be mounted here: {done.stderr.strip()}")
    try:
        yield folder
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True)


def fill(folder: Path, leave: int) -> None:
    """Takes all space but about `leave` bytes."""
    with open(folder / "filler", "wb") as file:
        file.write(b"\1" * max(0, os.statvfs(folder).f_bavail * os.statvfs(folder).f_frsize - leave))


def one_line(status: int, text: str) -> str:
    assert status == 2 and "Traceback" not in text, text
    found = [line for line in text.splitlines() if line.startswith("error: ")]
    assert len(found) == 1, text
    return found[0]


def leftovers(folder: Path) -> list[Path]:
    return [path for pattern in (".*.partial*", ".render-*") for path in folder.rglob(pattern)]


# ---- disk full -----------------------------------------------------------------------------------

def noise(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).random((40, 60, 3)).astype(np.float32)


def photograph(folder: Path) -> photographs.Photograph:
    import imagecodecs

    (folder / "x.png").write_bytes(imagecodecs.png_encode((noise(0) * 255).astype(np.uint8)))
    return photographs.read(folder / "x.png", "srgb")


@pytest.mark.parametrize("left", [0, 4096, 8192, 16384], ids=lambda n: f"{n} bytes left")
@pytest.mark.parametrize("name", ["map.exr", "facts.json", "foggy.png", "copy.png"])
def test_full_disk(name, left, tmp_path):
    """The real thing: nothing half written, no temporary file, the older result whole."""
    like = photograph(tmp_path)

    def write(path: Path, seed: int) -> None:
        if name.endswith(".exr"):
            write_map(path, noise(seed))
        elif name.endswith(".json"):
            write_json(path, noise(seed)[:4])
        elif name.startswith("copy"):
            photograph_writing.write_unchanged(path, like)
        else:
            photograph_writing.write_png(path, noise(seed), like)

    with mounted(tmp_path / "disk", 4096) as disk:
        write(disk / name, 1)
        before = (disk / name).read_bytes()
        assert len(before) > 4096
        needed = len(before)
        fill(disk, left)
        if left < needed:
            with pytest.raises(InputError) as caught:
                write(disk / name, 2)
            assert caught.value.place == str(disk / name) and "space left" in str(caught.value)
            assert (disk / name).read_bytes() == before
        assert sorted(path.name for path in disk.iterdir()) == sorted(["filler", name])


def test_full_disk_under_povray(tiny_scene, capfd):
    """POV-Ray says nothing of a picture that did not fit."""
    with mounted(tiny_scene.root / "build", 4096) as disk:
        assert tiny_scene.run("resolve", "photograph", "camera", "geometry", "sun_direction", "illumination",
                              "plan", "emit") == 0
        for left in (0, 4096, 8192, 20480):
            capfd.readouterr()
            fill(disk, left)
            status = tiny_scene.run("render")
            message = one_line(status, capfd.readouterr().err)
            assert str(tiny_scene.root / "build") in message and ("space" in message or "disk" in message)
            assert not leftovers(disk)
            for image in tiny_scene.build.runs.glob("*.exr"):
                assert np.isfinite(read_map(image)).all()
            (disk / "filler").unlink()
        assert tiny_scene.run("render", "decompose") == 0


def test_full_disk_at_the_lock(tiny_scene, capfd, monkeypatch):
    monkeypatch.setenv("FOG_MAKE", str(os.getpid()))
    with mounted(tiny_scene.root / "build", 1024) as disk:
        fill(disk, 0)
        message = one_line(tiny_scene.run("resolve"), capfd.readouterr().err)
        assert str(disk) in message and "No space left" in message
        (disk / "filler").unlink()
        assert tiny_scene.run("resolve") == 0


# ---- folders that may not be written ---------------------------------------------------------------

STAGES = ("resolve", "photograph", "plan", "render", "decompose", "composite", "report")


def test_read_only_file_system(tiny_scene, capfd):
    with mounted(tiny_scene.root / "build", 8192) as disk:
        assert tiny_scene.run() == 0
        before = {path: path.read_bytes() for path in disk.rglob("*") if path.is_file()}
        subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=True)
        for stage in STAGES:
            capfd.readouterr()
            status = tiny_scene.run(stage, overrides=("fog.visibility=3",))
            message = one_line(status, capfd.readouterr().err)
            assert str(disk) in message and "Read-only file system" in message
        assert {path: path.read_bytes() for path in disk.rglob("*") if path.is_file()} == before


@pytest.mark.slow
def test_somebody_elses_folder(tiny_scene):
    """As a person who may read the folders and not write them."""
    if os.getuid() != 0:
        pytest.skip("only root becomes another person")
    assert tiny_scene.run("resolve", "photograph", "camera") == 0
    for folder in [*tiny_scene.root.parents][:-1] + [tiny_scene.root]:
        if folder.stat().st_uid == 0 and folder.name.startswith(("pytest", tiny_scene.root.name)):
            folder.chmod(0o755)
    child = ("import os, sys; from pipeline.cli import main; import pipeline.stages.camera;"
             "import pipeline.stages.photograph, pipeline.stages.resolve, pipeline.scene.model;"
             # all plugins while its Python may still be read
             "pipeline.scene.model.scene_model();"
             f"os.setgid({NOBODY}); os.setuid({NOBODY}); sys.exit(main(sys.argv[1:]))")
    for stage in ("resolve", "photograph", "camera"):
        done = subprocess.run(
            [sys.executable, "-c", child, stage, "--scene", "tiny", "--scenes", str(tiny_scene.root / "scenes"),
             "--build", str(tiny_scene.root / "build"), *(["--set", "camera.roll=1"] * (stage == "resolve"))],
            cwd=PROJECT, capture_output=True, text=True, timeout=120)
        message = one_line(done.returncode, done.stderr)
        assert str(tiny_scene.root / "build") in message and "Permission denied" in message
    assert not leftovers(tiny_scene.root)


# ---- locks and older versions ----------------------------------------------------------------------

def test_lock_of_the_dead(scene):  # noqa: F811
    """Its number is in use again, by a process that began at another time."""
    lock = scene.build.shared / ".lock"
    for stated in (f"{os.getpid()} 1", "999999999 5", "garbage", "", f"{os.getpid()} ended"):
        lock.write_text(stated)
        result = scene.make("scene=tiny", "resolve")
        assert result.returncode == 0 and "waiting" not in result.stderr, (stated, result.stderr)


def test_build_of_an_older_version(scene):  # noqa: F811
    """Newer by its time stamps than every source, as after a copy: redone all the same."""
    (scene.build.input("format")).unlink()
    plan = read_json(scene.build.plan)
    scene.build.plan.write_text(json.dumps({key: plan[key] for key in plan if key != "runs"}))
    geometry = read_json(scene.build.geometry)
    scene.build.geometry.write_text(json.dumps({key: geometry[key] for key in geometry if key != "lights"}))
    for path in (scene.root / "build").rglob("*"):
        os.utime(path)
    assert stages(scene.made())[0] == "photograph"
    assert "runs" in read_json(scene.build.plan) and read_json(scene.build.input("format")) == FORMAT
    assert scene.would_run() == []


@pytest.mark.parametrize("artefact, key, stage", [
    ("plan", "runs", "render"), ("plan", "lights", "decompose"), ("geometry", "lights", "illumination"),
    ("camera", "width_pixel", "geometry"), ("illumination", "lights", "decompose"),
    ("sun_direction", "suns", "illumination"), ("illumination", "lights.lamp.strength", "decompose"),
    ("plan", "runs.0.kind", "emit"),
])
def test_missing_key(artefact, key, stage, original, tiny_scene, capfd):  # noqa: F811
    """By hand, without make: a line that names the file and what it lacks."""
    import shutil

    shutil.copytree(original.root / "build", tiny_scene.root / "build")
    path = getattr(tiny_scene.build, artefact)
    stated = json.loads(path.read_text())
    *parents, key = [int(word) if word.isdecimal() else word for word in key.split(".")]
    inner = stated
    for parent in parents:
        inner = inner[parent]
    del inner[key]
    path.write_text(json.dumps(stated))
    message = one_line(tiny_scene.run(stage), capfd.readouterr().err)
    assert path.name in message and key in message and "remove the scene's build folder" in message


@pytest.mark.parametrize("name, stage", [("depth.exr", "decompose"), ("surfaces.exr", "decompose"),
                                         ("transmittance.exr", "composite"), ("in_scattering.exr", "composite")])
@pytest.mark.parametrize("size", [(1, 1), (9, 24)], ids=lambda size: f"{size[1]}x{size[0]}")
def test_map_of_another_size(name, stage, size, scene, capfd):  # noqa: F811
    """One pixel would stand for all of them, and nobody would notice."""
    path = scene.build.out / name
    older = read_map(path)
    write_map(path, np.resize(older, (*size, *older.shape[2:])))
    message = one_line(scene.run(stage), capfd.readouterr().err)
    assert f"{path}: a map of {size[1]}x{size[0]} pixels, not 24x18; delete it and run the pipeline again" in message


@pytest.mark.parametrize("name, first", [("runs/transmittance_lamp.exr", "render"),
                                         ("basis/irradiance_lamp.exr", "illumination")])
def test_deleted_render_is_made_again(name, first, scene):  # noqa: F811
    """As the line about a damaged picture advises."""
    (scene.build.shared / name).unlink()
    assert scene.would_run()[0] == first
    said = scene.made(str(scene.build.maps))
    assert stages(said)[0] == first and rendered(said) == [Path(name).stem]
    assert scene.would_run(str(scene.build.maps)) == []


def test_render_of_a_light_that_is_gone_goes(scene):  # noqa: F811
    text = scene.file.read_text()
    start, end = text.index("  bulb:\n"), text.index("fog:\n")
    scene.file.write_text(text[:start] + text[end:])
    assert scene.run("resolve", "geometry", "sun_direction", "illumination") == 0
    assert {path.stem for path in scene.build.basis.glob("irradiance_*")} == {"irradiance_lamp"}
