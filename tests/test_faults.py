"""POV-Ray killed, crashing, hanging, warning or not itself: one line, nothing half written, nothing kept back."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.imaging.maps import read_map, write_map
from pipeline.rendering import povray
from pipeline.scene.artefacts import read_json

PROJECT = Path(__file__).resolve().parent.parent
BEFORE_RENDERS = ("resolve", "photograph", "camera", "geometry", "sun_direction")
BEFORE_FOG = (*BEFORE_RENDERS, "illumination", "plan", "emit")
ANSWERS = '#!/bin/sh\n[ "$1" = --version ] && echo POV-Ray 3.7.0 && exit\n'
HEAD = "#version 3.7;\nglobal_settings { assumed_gamma 1 }\ncamera { location <0, 1, -4> look_at 0 }\n"
LIT = HEAD + "light_source { <0, 3, 0> rgb 1 }\nbox { -9, 9 pigment { rgb 1 } hollow }\n"
#: POV-Ray 3.7.0.10 writes the whole picture of this and then crashes while it ends.
CRASH = LIT + ("media { scattering { 1, 0.05 } samples 2 density { function { exp(-y) }"
               " color_map { [0 rgb 0] [1 rgb 1] } } }\n")
#: Minutes of work at any size.
ENDLESS = LIT + "media { scattering { 1, 0.05 } intervals 1 samples 200000 method 3 }\n"


@pytest.fixture(autouse=True)
def fresh_povray(monkeypatch):
    """POV-Ray looked up anew, and nothing said yet."""
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    monkeypatch.setattr(povray, "_SAID", set())
    for again in (True, False):
        povray.program.cache_clear()
        povray.version.cache_clear()
        if again:
            yield


def one_line(status: int, text: str) -> str:
    """The refusal: status 2, one line that says so, no traceback."""
    assert status == 2 and "Traceback" not in text, text
    found = [line for line in text.splitlines() if line.startswith("error: ")]
    assert len(found) == 1, text
    return found[0]


def stand_in(folder: Path, script: str, monkeypatch) -> Path:
    program = folder / "povray"
    program.write_text(script)
    program.chmod(0o755)
    monkeypatch.setenv("POVRAY", str(program))
    return program


def leftovers(folder: Path) -> list[Path]:
    return [path for pattern in (".*.partial*", ".render-*") for path in folder.rglob(pattern)]


def until(condition, seconds: float = 60):
    """The first true value of `condition`; the limit only ends a test that fails."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if found := condition():
            return found
        time.sleep(0.05)
    raise AssertionError("it never came")


def processes_naming(words: str) -> list[int]:
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            if words in path.read_bytes().decode(errors="replace").replace("\0", " "):
                found.append(int(path.parent.name))
        except OSError:
            pass  # ended meanwhile
    return [pid for pid in found if pid != os.getpid()]


def cli(scene, stage: str, **more) -> subprocess.Popen:
    return subprocess.Popen(
        [sys.executable, "-m", "pipeline", stage, "--scene", "tiny", "--scenes", str(scene.root / "scenes"),
         "--build", str(scene.root / "build")], cwd=PROJECT, text=True, stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True, **more)


# ---- killed and interrupted ----------------------------------------------------------------------

@pytest.mark.parametrize("ending", ["POV-Ray killed", pytest.param("interrupted", marks=pytest.mark.slow)])
def test_render_that_is_ended(ending, tiny_scene, capfd):
    """The real POV-Ray at endless work; what was rendered before stays and is not rendered again."""
    assert tiny_scene.run(*BEFORE_FOG) == 0
    runs = [run["id"] for run in read_json(tiny_scene.build.plan)["runs"]]
    slow = tiny_scene.build.pov / f"{runs[1]}.pov"
    sound = slow.read_text()
    slow.write_text(ENDLESS)
    stage = cli(tiny_scene, "render")
    # POV-Ray alone is started with the file as an argument
    renderer = until(lambda: [pid for pid in processes_naming(f"+I{slow.resolve()}")])[0]
    until((tiny_scene.build.runs / f"{runs[0]}.sha256").exists)  # they go side by side
    os.kill(renderer if ending == "POV-Ray killed" else stage.pid,
            signal.SIGKILL if ending == "POV-Ray killed" else signal.SIGINT)
    said = stage.communicate(timeout=60)[1]
    if ending == "POV-Ray killed":
        message = one_line(stage.returncode, said)
        assert "ended by signal SIGKILL; run again" in message and "function densities" not in message
    else:
        assert stage.returncode == 130 and "interrupted; what is finished is kept" in said
    assert not processes_naming(f"+I{slow.resolve()}")
    assert (tiny_scene.build.runs / f"{runs[0]}.exr").exists()
    assert not (tiny_scene.build.runs / f"{runs[1]}.exr").exists()
    assert not leftovers(tiny_scene.root)

    slow.write_text(sound)
    capfd.readouterr()
    assert tiny_scene.run("render") == 0
    assert f"{runs[0]}: unchanged" in capfd.readouterr().err


def test_crash_with_a_whole_picture(tiny_scene, capfd):
    (tiny_scene.folder / "irradiance.pov").write_text(CRASH)
    message = one_line(tiny_scene.run(*BEFORE_RENDERS, "illumination"), capfd.readouterr().err)
    assert "ended by signal SIGSEGV" in message and "function densities" in message
    assert not list(tiny_scene.build.basis.glob("*.exr")) and not leftovers(tiny_scene.root)


def test_hanging_with_children(tiny_scene, capfd, monkeypatch):
    """The whole group is ended: what POV-Ray started would hold the log open."""
    pids = tiny_scene.root / "pids"
    stand_in(tiny_scene.root, ANSWERS + f"sleep 600 &\necho $! $$ >> {pids}\nwait\n", monkeypatch)
    message = one_line(tiny_scene.run(*BEFORE_RENDERS, overrides=("render.timeout=0.5",))
                       or tiny_scene.run("illumination"), capfd.readouterr().err)
    assert "took longer than 0.5 s" in message and "raise render.timeout" in message
    for pid in pids.read_text().split():
        until(lambda: not Path(f"/proc/{pid}").exists()
              or Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z")
    assert not leftovers(tiny_scene.root)


# ---- what is not POV-Ray 3.7 ---------------------------------------------------------------------

@pytest.mark.parametrize("script, says", [
    ("#!/bin/sh\necho POV-Ray 3.6.1 >&2\n", "is version 3.6.1; install POV-Ray 3.7"),
    ("#!/bin/sh\necho POV-Ray 3.8.0-beta >&2\n", "is version 3.8.0; install POV-Ray 3.7"),
    ("#!/bin/sh\necho 'POV-Ray 3.7.0'; echo '  Supported image formats: gif png jpeg'\n",
     "was built without OpenEXR"),
    ("#!/bin/sh\nprintf '\\377\\376'\n", "does not say its version"),
    ("#!/bin/sh\nexec sleep 600\n", "does not say its version within 1 s"),
    ("#!/no/such/interpreter\n", "cannot be run (No such file or directory)"),
    ("\x7fELF of another machine", "cannot be run (Exec format error)"),
    (ANSWERS + "exit 255\n", "POV-Ray failed: it said nothing"),
], ids=["3.6", "3.8", "no OpenEXR", "no text", "hangs", "no interpreter", "no program", "status 255"])
def test_other_programs(script, says, tmp_path, monkeypatch):
    program = stand_in(tmp_path, script, monkeypatch)
    monkeypatch.setattr(povray, "VERSION_TIMEOUT", 1.0)
    pov = tmp_path / "x.pov"
    pov.write_text(LIT)
    with pytest.raises(InputError) as caught:
        povray.render(pov, tmp_path / "x.exr", 8, 6)
    assert says in str(caught.value)
    assert caught.value.place in (str(program), str(pov))
    assert not (tmp_path / "x.exr").exists() and not leftovers(tmp_path)


def test_program_that_may_not_be_run(tmp_path, monkeypatch):
    stand_in(tmp_path, "#!/bin/sh\n", monkeypatch).chmod(0o644)
    with pytest.raises(InputError, match="povray: is no program that may be run"):
        povray.version()


# ---- pictures ------------------------------------------------------------------------------------

@pytest.mark.parametrize("fault, says", [
    ("truncated", "no readable picture"), ("size", "has 9x6 pixels, not 8x6"),
    ("NaN", "1 values of the render are not finite"), ("infinite", "1 values of the render are not finite"),
])
def test_picture(fault, says, tmp_path, monkeypatch):
    pixels = np.ones((6, 9 if fault == "size" else 8, 3))
    if fault in ("NaN", "infinite"):
        pixels[2, 3, 1] = np.nan if fault == "NaN" else np.inf
    write_map(tmp_path / "wrong.exr", pixels)
    if fault == "truncated":
        os.truncate(tmp_path / "wrong.exr", (tmp_path / "wrong.exr").stat().st_size - 20)
    stand_in(tmp_path, ANSWERS + 'for a; do case "$a" in +O*) out=${a#+O};; esac; done\n'
             f'cp {tmp_path}/wrong.exr "$out"\n', monkeypatch)
    pov = tmp_path / "x.pov"
    pov.write_text(LIT)
    write_map(tmp_path / "x.exr", np.zeros((6, 8, 3)))
    with pytest.raises(InputError, match=says):
        povray.render(pov, tmp_path / "x.exr", 8, 6)
    assert not read_map(tmp_path / "x.exr").any(), "the older picture is kept"
    assert not (tmp_path / "x.sha256").exists(), "and is not taken for the new one"
    assert not leftovers(tmp_path)


# ---- warnings ------------------------------------------------------------------------------------

def test_warnings_are_said_once_and_kept(tiny_scene, capfd):
    template = tiny_scene.folder / "lights" / "area.inc"
    template.parent.mkdir()
    text = (PROJECT / "templates/lights/area.inc").read_text()
    template.write_text(text + '\n#warning "the lamp is odd and this is a long line that POV-Ray breaks in two"\n')
    assert tiny_scene.run() == 0
    said = [line for line in capfd.readouterr().err.splitlines() if line.startswith("warning: ")]
    wanted = (f"{template}:{len(text.splitlines()) + 2}: POV-Ray: the lamp is odd and this is a long line that"
              " POV-Ray breaks in two")
    assert said == [f"warning: {wanted}"], "one line for all runs, none of a union of one shape"
    assert tiny_scene.run("report") == 0
    assert wanted in json.loads(tiny_scene.build.manifest.read_text())["povray_warnings"]
    assert f'<li>{wanted} <span class="soft">(render)</span>' in tiny_scene.build.report.read_text()


def test_sunlight_through_a_window_gives_no_warning(tiny_scene, capfd):
    tiny_scene.replace("lights:\n", "lights:\n  sun:\n    type: sun\n    direction: [0.6, -0.8, 0.1]\n    irradiance: [5, 4, 3]\n"
                       "    openings:\n      window:\n"
                       "        window: {points: [[-2, 1, -3], [-2, 2, -3], [-2, 2, -2], [-2, 1, -2]]}\n"
                       "        patches: [{points: [[-1.25, 0, -2.875], [-0.5, 0, -2.75], [-0.5, 0, -1.75],"
                       " [-1.25, 0, -1.875]]}]\n")
    assert tiny_scene.run(*BEFORE_FOG, "render", overrides=("render.glow=rendered",)) == 0
    assert (tiny_scene.build.runs / "in_scattering_sun.exr").exists()
    assert "warning" not in capfd.readouterr().err
