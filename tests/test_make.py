"""The real Makefile: what it redoes, what it refuses, and what an interrupted run leaves for the next."""

from __future__ import annotations

import fcntl
import os
import random
import re
import shutil
import signal
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from pipeline.cli import STAGES
from pipeline.imaging.maps import read_map, read_metadata
from pipeline.scene.artefacts import read_json
from tests.conftest import TinyScene, write_tiny

PROJECT = Path(__file__).resolve().parent.parent
FROM = {stage: list(STAGES)[number:] for number, stage in enumerate(STAGES)}
FOG_RUNS = ["clear_lamp", "transmittance_lamp"]  # nothing stands before the bulb and the lamp
RESULTS = ("transmittance.exr", "in_scattering.exr", "in_scattering_lamp.exr", "in_scattering_bulb.exr",
           "depth.exr", "foggy.exr", "foggy.png")


def environment(**more: str) -> dict[str, str]:
    """A person's own shell, without what a `make test` around this told its stages."""
    clean = {key: value for key, value in os.environ.items()
             if not key.startswith(("FOG_", "MAKE", "MFLAGS")) and key not in ("scene", "fog")}
    return {**clean, "OMP_NUM_THREADS": "1", **more}


@dataclass
class Made(TinyScene):
    """A scene called `tiny`, and make on it."""

    def command(self, *arguments: str) -> list[str]:
        return ["make", f"SCENES={self.root / 'scenes'}", f"BUILD={self.root / 'build'}", *arguments]

    def make(self, *arguments: str, **more: str) -> subprocess.CompletedProcess:
        return subprocess.run(self.command(*arguments), cwd=PROJECT, env=environment(**more), text=True,
                              stdin=subprocess.DEVNULL, capture_output=True, timeout=300)

    def made(self, *arguments: str, **more: str) -> str:
        """What a make that succeeds says."""
        result = self.make("scene=tiny", *arguments, **more)
        assert result.returncode == 0, result.stderr
        return result.stderr

    def would_run(self, *arguments: str) -> list[str]:
        """Stages that are out of date, by the inputs as they stand."""
        text = self.make("-n", "scene=tiny", *arguments).stdout
        return [stage for stage in re.findall(r"-m pipeline (\w+)", text) if stage != "resolve"]

    def redone_for(self, *arguments: str) -> list[str]:
        """Stages that are out of date once the scene file and the overrides were read."""
        self.made("resolve", *arguments)
        return self.would_run(*arguments)

    def files(self) -> dict[Path, int]:
        return {path: path.stat().st_mtime_ns for path in (self.root / "build").rglob("*") if path.is_file()}


def stages(said: str) -> list[str]:
    """Stages that ran, in their order."""
    return [line.partition(":")[0] for line in said.splitlines() if line.partition(":")[0] in STAGES]


def rendered(said: str) -> list[str]:
    """Runs that POV-Ray did anew."""
    return re.findall(r"^  (?:\[\d+/\d+\] )?(\w+): [\d.]+ s$", said, re.M)


@pytest.fixture(scope="session")
def original(tmp_path_factory) -> Made:
    """The tiny scene made once for all tests and all workers; only looked at, never changed."""
    base = tmp_path_factory.getbasetemp()
    root = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "made"
    root.mkdir(exist_ok=True)
    scene = Made(root)
    with open(root / "lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (root / "said").exists():
            write_tiny(scene.folder)
            start = time.monotonic()
            said = scene.made()
            (root / "seconds").write_text(str(time.monotonic() - start))
            (root / "said").write_text(said)
    return scene


@pytest.fixture
def scene(original, tmp_path) -> Made:
    """The made scene, to change: a copy with its time stamps."""
    for part in ("scenes", "build"):
        shutil.copytree(original.root / part, tmp_path / part)
    return Made(tmp_path)


@pytest.fixture
def fresh(tmp_path) -> Made:
    """The scene, not made yet."""
    scene = Made(tmp_path)
    write_tiny(scene.folder)
    return scene


# ---- what is redone ----------------------------------------------------------------------------

def test_everything_is_made_in_order(original):
    said = (original.root / "said").read_text()
    assert stages(said) == FROM["photograph"]
    assert sorted(rendered(said)) == sorted(["irradiance_lamp", "irradiance_bulb", *FOG_RUNS])
    out = original.build.out
    assert all((out / name).is_file() for name in (*RESULTS, "report.html", "manifest.json", "plan.json"))
    assert not leftovers(out)


def test_second_run_does_nothing(scene):
    before = scene.files()
    result = scene.make("scene=tiny")
    assert (result.returncode, result.stderr) == (0, "")
    # whose make owns the folder is the one thing that a second run notes down
    assert {p: t for p, t in scene.files().items() if p.name != ".lock"} == {
        p: t for p, t in before.items() if p.name != ".lock"}


@pytest.mark.parametrize("edit, redone", [
    ((), []),
    (("composite.exposure=1",), ["composite", "report"]),
    (("lights.lamp.gain=2",), FROM["decompose"]),
    (("lights.lamp.radiance=[1, 2, 3]",), FROM["illumination"]),
    (("fog.visibility=4",), FROM["plan"]),
    (("render.samples=9",), FROM["plan"]),
    (("illumination.size=64",), FROM["illumination"]),
    (("lights.lamp.sub_lights=3",), FROM["geometry"]),
    (("shapes.room.upper=[2, 2.6, 1]",), FROM["geometry"]),
    (("camera.roll=1",), FROM["camera"]),
    (("photograph.colour_space=linear",), FROM["photograph"]),
], ids=lambda x: x[0].partition("=")[0] if isinstance(x, tuple) and x else "")
def test_override_redoes_what_depends_on_it(edit, redone, scene):
    assert scene.redone_for(*edit) == redone


@pytest.mark.parametrize("file, redone", [
    ("pipeline/imaging/colour.py", FROM["photograph"]),
    ("pipeline/stages/photograph.py", FROM["photograph"]),
    ("pipeline/geometry/vanishing_points.py", FROM["camera"]),
    ("pipeline/plugins/lights/area.py", FROM["geometry"]),
    ("pipeline/estimation/sun_direction.py", FROM["sun_direction"]),
    ("pipeline/estimation/albedo.py", FROM["illumination"]),
    ("pipeline/stages/plan.py", FROM["plan"]),
    ("pipeline/physics/upsampling.py", FROM["decompose"]),
    ("pipeline/physics/composition.py", FROM["decompose"]),
    ("pipeline/stages/composite.py", FROM["composite"]),
    ("pipeline/stages/report.py", FROM["report"]),
    ("pipeline/stages/closure.py", []),
    ("templates/lights/area.inc", FROM["illumination"]),
    ("templates/head.inc", FROM["illumination"]),
    ("templates/bounce.pov", FROM["illumination"]),
    ("templates/in_scattering.pov", FROM["plan"]),
    ("templates/phase_functions/isotropic.inc", FROM["plan"]),
    ("povray_includes/fog_scattering.inc", FROM["plan"]),
    ("templates/closure.pov", []),
    ("templates/report.html", FROM["report"]),
])
def test_source_or_template_redoes_what_depends_on_it(file, redone, original):
    assert (PROJECT / file).is_file()
    assert original.would_run("-W", file) == redone


def test_changed_photograph(scene):
    photograph = scene.folder / "photograph.png"
    photograph.write_bytes(photograph.read_bytes() + b"\0")  # behind the picture's end
    assert scene.redone_for() == FROM["photograph"]


def test_same_content_written_again_redoes_nothing(scene):
    for path in scene.folder.iterdir():
        path.write_bytes(path.read_bytes())
    assert scene.redone_for() == []


@pytest.mark.parametrize("name", ["transmittance.exr", "foggy.exr", "depth.exr"])
def test_removed_result_is_made_again(name, scene):
    (scene.build.out / name).unlink()
    assert scene.would_run()[0] == {"transmittance.exr": "decompose", "foggy.exr": "composite",
                                    "depth.exr": "geometry"}[name]


def test_gain_renders_nothing(scene):
    before = read_map(scene.build.in_scattering("lamp"))
    said = scene.made(str(scene.build.maps), "lights.lamp.gain=2")
    assert stages(said) == ["decompose"] and rendered(said) == []
    assert np.array_equal(read_map(scene.build.in_scattering("lamp")), 2 * before)


def test_strength_renders_nothing(scene):
    said = scene.made(str(scene.build.runs_done), "lights.lamp.radiance=[2, 2, 2]")
    assert stages(said) == ["illumination", "plan", "emit", "render"] and rendered(said) == []
    assert read_json(scene.build.illumination)["lights"]["lamp"]["strength"] == [2, 2, 2]


def test_fogs_are_kept_apart_and_leave_the_light_alone(scene):
    before = {name: (scene.build.out / name).read_bytes() for name in RESULTS}
    said = scene.made(str(scene.build.out / "thick/maps.json"), "fog=thick")
    assert stages(said) == ["plan", "emit", "render", "decompose"]
    assert sorted(rendered(said)) == FOG_RUNS
    assert {name: (scene.build.out / name).read_bytes() for name in RESULTS} == before
    thick = read_map(scene.build.out / "thick/transmittance.exr")
    assert np.median(thick) < np.median(read_map(scene.build.transmittance))
    scene.made("resolve", "fog=thick", "fog.visibility=3")
    assert read_json(scene.build.out / "thick/inputs/fog.json")["visibility"] == 3
    assert read_json(scene.build.out / "inputs/fog.json")["visibility"] == 6


# ---- a scene's own templates -------------------------------------------------------------------

@pytest.mark.parametrize("place", ["lights/area.inc", "templates/lights/area.inc"])
def test_own_template_wins_and_its_edits_are_seen(place, scene):
    own = scene.folder / place
    own.parent.mkdir(parents=True)
    text = (PROJECT / "templates/lights/area.inc").read_text()
    exposure = next(line for line in text.splitlines() if "Fog_Exposure" in line)
    dimmed = exposure + "\n// dimmed\n#declare Fog_Exposure = Fog_Exposure / 2;"
    own.write_text(text.replace(exposure, dimmed))
    os.utime(own, (0, 0))  # one copied with an old time stamp counts as well
    before = read_map(scene.build.in_scattering("lamp"))
    said = scene.made(str(scene.build.maps))
    assert stages(said) == ["illumination", "plan", "emit", "render", "decompose"]
    assert set(rendered(said)) == {"irradiance_lamp", "clear_lamp", "transmittance_lamp", "in_scattering_lamp"}
    assert "// dimmed" in (scene.build.pov / "in_scattering_lamp.pov").read_text()
    # rendered by 2 x 2 small lights now, where it was integrated over the lamp
    assert read_map(scene.build.in_scattering("lamp")).sum() == pytest.approx(before.sum() / 2, rel=0.2)

    own.unlink()
    assert scene.redone_for() == FROM["illumination"], "the project's own template is back"


# ---- what is refused, and what never runs -------------------------------------------------------

SHELL_WORDS = ["$(shell touch {0})", "$$(touch {0})", "`touch {0}`", "tiny;touch {0}",
               "tiny|touch {0}", "${{x:=`touch {0}`}}", "tiny' ; touch {0} '", 'tiny" ; touch {0} "',
               "tiny\ntouch {0}", "tiny # touch {0}"]


def refused(result: subprocess.CompletedProcess) -> str:
    """The one line that says what is wrong; Make's own `*** [target] Error 2` may stand below it."""
    makes_own = re.compile(r"make: \*\*\* \[.*\] Error \d+$")
    lines = [line for line in result.stderr.splitlines() if not makes_own.match(line)]
    assert result.returncode == 2 and len(lines) == 1, result.stderr
    assert lines[0].startswith(("error: ", "Makefile:")) and "missing separator" not in lines[0]
    return lines[0]


@pytest.mark.parametrize("name", ["../tiny", "a/b", "..", ".hidden", "a..b", "two words", "-n", "~root",
                                  "%", "*", "tiny,x", "tïny"])
@pytest.mark.parametrize("variable", ["scene", "fog"])
def test_names_that_leave_their_folder(variable, name, fresh):
    said = refused(fresh.make("scene=tiny", f"{variable}={name}"))
    assert f"{variable} name '{name}'" in said
    assert not (fresh.root / "build").exists()


def test_unknown_scene_and_fog(fresh):
    said = refused(fresh.make("scene=tinny"))
    assert "no scene is called 'tinny'; use one of tiny (did you mean 'tiny'?)" in said
    assert "no fog is called 'thik'; use one of thick" in refused(fresh.make("scene=tiny", "fog=thik"))
    assert not (fresh.root / "build").exists()


@pytest.mark.parametrize("words", SHELL_WORDS)
@pytest.mark.parametrize("variable", ["scene", "fog"])
def test_names_reach_no_shell(variable, words, fresh):
    result = fresh.make("scene=tiny", f"{variable}={words.format(fresh.root / 'touched')}")
    assert result.returncode == 2
    assert not (fresh.root / "touched").exists() and not (fresh.root / "build").exists()


def test_values_reach_no_shell(fresh):
    touched = fresh.root / "touched"
    lines = [words.format(touched) for words in SHELL_WORDS if "\n" not in words]
    refused(fresh.make("resolve", "scene=tiny", *(f"fog.value{n}={words}" for n, words in enumerate(lines))))
    assert not touched.exists()
    # one that is accepted goes through as it stands
    name = f"$(touch {touched.name}) `touch {touched.name}`; ' \".png"
    (fresh.folder / "photograph.png").rename(fresh.folder / name)
    fresh.made("resolve", f"photograph.file={name}")
    assert read_json(fresh.build.input("photograph"))["file"] == name
    assert not touched.exists() and not (PROJECT / touched.name).exists()


def test_annotations_come_and_go_by_files_of_any_name(fresh):
    touched = fresh.root / "touched"
    for words in ("$(shell touch {0})", "tiny\ntouch {0}"):
        refused(fresh.make("import-annotations", "scene=tiny", f"file={words.format(touched)}"))
    target = fresh.root / f"$(touch {touched.name}) `touch {touched.name}`; ' \".json"
    fresh.replace("fog:", "illumination: {type: liu_xing, shadowed: [{pixels: [[1, 2], [9, 2], [9, 8]]}]}\nfog:")
    assert fresh.make("export-annotations", "scene=tiny", f"file={target}").returncode == 0
    before = fresh.file.read_bytes()
    said = fresh.make("import-annotations", "scene=tiny", f"file={target}")
    assert said.returncode == 0 and "imported: illumination.shadowed" in said.stdout, said.stderr
    assert fresh.file.read_bytes() == before, "what is drawn already is drawn as before"
    assert not touched.exists() and not (PROJECT / touched.name).exists()


@pytest.mark.parametrize("words", SHELL_WORDS)
def test_a_photographs_name_reaches_no_shell(words, fresh):
    fresh.make("-n", "annotate", "scene=new", f"photo={words.format(fresh.root / 'touched')}")
    assert not (fresh.root / "touched").exists()


def test_names_from_the_environment_are_checked_too(fresh):
    touched = fresh.root / "touched"
    assert "scene name" in refused(fresh.make(scene=f"$(shell touch {touched})"))
    assert not touched.exists()


def test_value_with_spaces(fresh):
    assert fresh.make("resolve", "scene=tiny", "lights.lamp.radiance=[1, 2,  3]").returncode == 0
    assert read_json(fresh.build.input("strengths"))["lamp"] == [1, 2, 3]


def test_group_is_overridden_before_what_is_in_it(fresh):
    fresh.made("resolve", "fog.phase_function.asymmetry=0.5", "fog.phase_function={type: henyey_greenstein}")
    phase = read_json(fresh.build.input("fog"))["phase_function"]
    assert phase == {"type": "henyey_greenstein", "asymmetry": 0.5}


@pytest.mark.parametrize("arguments, says", [
    (("visibility=3",), "no variable is called 'visibility'"),
    (("scene=tiny", "Fog=thick"), "no variable is called 'Fog'"),
    (("fog=thick",), "no scene is named: make scene=bathroom"),
    (("fog.visibility=3",), "no scene is named"),
    (("all",), "no scene is named: make all scene=bathroom"),
    (("closure",), "no scene is named"),
    (("compare",), "no scene is named: make compare scene=bathroom"),
    (("truth", "fog=thick"), "no scene is named: make truth scene=bathroom"),
    (("scene=tiny", "BUILD=a b"), "BUILD='a b'"),
    (("scene=tiny", "BUILD="), "BUILD=''"),
    (("scene=tiny", "SCENES=$(shell touch x)"), "SCENES='$(shell touch x)'"),
    (("photograph", "scene=tiny"), "has no model/render.py"),
    (("import-annotations", "file=a.json"), "no scene is named: make import-annotations scene=bathroom"),
    (("import-annotations", "scene=tiny"), "no file is named: make import-annotations scene=tiny file=annotations.json"),
    (("export-annotations", "scene=tiny", "file=a.json", "to=../x"), "to name '../x'"),
    (("scene=tiny", "file=a.json"), "file= is for annotations: make import-annotations scene=tiny file=annotations.json"),
    (("import-annotations", "scene=tiny", "file=no.json"), "no.json: no such file"),
    (("import-annotations", "scene=tiny", "file=no.json", "replace=no"), "replace=no; give replace=yes"),
    (("scene=tiny", "POVRAY=no-such-povray"), "no program 'no-such-povray'"),
    (("annotate",), "no scene is named: make annotate scene=bathroom"),
    (("scene=tiny", "photo=IMG.jpg"), "photo= and port= are for the page"),
    (("annotate", "scene=tiny", "port=many"), "port='many'"),
    (("annotate", "scene=tiny", "fog=thick"), "leave out fog=thick"),
    (("annotate", "scene=tiny", "fog.visibility=3"), "leave out fog.visibility=..."),
])
def test_other_mistakes(arguments, says, fresh):
    assert says in refused(fresh.make(*arguments))
    assert not (fresh.root / "build").exists()


def test_truth_runs_nothing_of_a_scenes_folder(fresh):
    model = fresh.root / "scenes" / "tiny" / "model"
    model.mkdir()
    (model / "render.py").write_text("open('ran', 'w').close()\n")
    assert "the project carries no model of 'tiny'" in refused(fresh.make("truth", "scene=tiny"))
    assert not list(fresh.root.rglob("ran"))


def test_no_scene_shows_help(fresh):
    result = fresh.make()
    assert result.returncode == 0 and "make scene=NAME" in result.stdout
    targets = set(re.findall(r"^(?:\.PHONY: )(.*)$", (PROJECT / "Makefile").read_text(), re.M))
    inner = {"all", "resolve", "FORCE", "povray", "help"}
    public = {name for line in targets for name in line.split()} - inner
    assert [name for name in public if name not in result.stdout] == []


def test_clean_removes_only_what_was_made(scene):
    build = scene.root / "build"
    mine = build / "mine" / "notes.txt"
    mine.parent.mkdir()
    mine.write_text("not the pipeline's")
    outside = scene.root / "outside" / "inputs"
    outside.mkdir(parents=True)
    for arguments in (["scene=../outside"], ["scene=$(shell touch x)"], ["scene=tiny", "fog=../../outside"]):
        refused(scene.make("clean", *arguments))
    scene.made("resolve", "fog=thick")
    assert scene.make("clean", "scene=tiny", "fog=thick").returncode == 0
    assert not (build / "tiny/thick").exists() and scene.build.report.exists()
    assert scene.make("clean").returncode == 0
    assert not (build / "tiny").exists() and mine.exists() and outside.exists()


# ---- set-up --------------------------------------------------------------------------------------

@pytest.fixture
def machine(tmp_path):
    """A copy of the Makefile on a machine that has only what a test gives it; runs `make setup` there."""
    project, programs = tmp_path / "project", tmp_path / "programs"
    (project / "pipeline").mkdir(parents=True)
    programs.mkdir()
    shutil.copy(PROJECT / "Makefile", project)
    (project / "pipeline/requirements.lock").write_text("")
    for name in ("make", "find", "touch", "mkdir", "env"):
        (programs / name).symlink_to(shutil.which(name))

    def add(name: str, script: str) -> None:
        (programs / name).write_text("#!/bin/bash\n" + script)
        (programs / name).chmod(0o755)

    def run(*arguments: str) -> subprocess.CompletedProcess:
        return subprocess.run(["make", "setup", *arguments], cwd=project, text=True,
                              capture_output=True, timeout=60, stdin=subprocess.DEVNULL,
                              env={"PATH": str(programs), "LC_ALL": "C"})

    run.add, run.project = add, project
    add("id", "echo 1000\n")
    return run


#: A Python that passes all checks and makes an environment whose pip installs nothing.
PYTHON = 'if [ "$1 $2" = "-m venv" ]; then mkdir -p .venv/bin; touch .venv/bin/python; {} ; fi\n'.format(
    r"printf '#!/bin/bash\necho installed >>installed\n' > .venv/bin/python; /bin/chmod +x .venv/bin/python")


@pytest.mark.parametrize("python, says", [
    (None, "no program 'python3'; install Python 3.11 or newer"),
    ('[[ "$2" != *version_info* ]]\n', "python3 is older than 3.11"),
    ('[[ "$2" != *ensurepip* ]]\n', "its venv module (on Debian: sudo apt-get install python3-venv)"),
])
def test_no_python(python, says, machine):
    machine.add("povray", "")
    if python:
        machine.add("python3", python)
    assert says in refused(machine())
    assert not (machine.project / ".venv").exists()


def test_environment_that_is_a_link_is_left_alone(machine, tmp_path):
    machine.add("python3", "touch called\n")
    (tmp_path / "elsewhere").mkdir()
    (machine.project / ".venv").symlink_to(tmp_path / "elsewhere")
    (tmp_path / "elsewhere" / "precious").write_text("")
    assert ".venv is a link" in refused(machine())
    assert (tmp_path / "elsewhere" / "precious").exists()


def test_set_up_once(machine):
    machine.add("python3", PYTHON)
    machine.add("povray", "")
    assert machine().returncode == 0
    assert (machine.project / "installed").read_text() == "installed\n"
    again = machine()
    assert (again.returncode, again.stderr) == (0, "")
    assert again.stdout in ("", "make: Nothing to be done for 'setup'.\n")
    assert (machine.project / "installed").read_text() == "installed\n"


def test_packages_that_cannot_be_installed_are_tried_again(machine):
    machine.add("python3", PYTHON.replace("echo installed", "exit 1; echo installed"))
    machine.add("povray", "")
    assert "could not be installed" in refused(machine())
    assert not (machine.project / ".venv/ready").exists()


@pytest.mark.parametrize("programs", [{}, {"apt-get": "echo called >>called\n"},
                                      {"apt-get": "echo called >>called\n", "sudo": "exit 1\n"}])
def test_no_povray_and_not_permitted_to_install_it(programs, machine):
    machine.add("python3", PYTHON)
    for name, script in programs.items():
        machine.add(name, script)
    assert "POV-Ray is not installed; run: sudo apt-get install povray" in refused(machine())
    assert not (machine.project / "called").exists()


@pytest.mark.parametrize("user, sudo", [("0", None), ("1000", '[ "$1" = -n ] && shift; "$@"\n')])
def test_povray_is_installed_where_permitted(user, sudo, machine, tmp_path):
    machine.add("python3", PYTHON)
    machine.add("id", f"echo {user}\n")
    machine.add("true", "")
    machine.add("apt-get", f'echo "$1" >>called; [ "$1" = install ] && touch {tmp_path}/programs/povray '
                           f'&& /bin/chmod +x {tmp_path}/programs/povray\nexit 0\n')
    if sudo:
        machine.add("sudo", sudo)
    result = machine()
    assert result.returncode == 0, result.stderr
    assert (machine.project / "called").read_text() == "update\ninstall\n"


def test_project_in_a_folder_with_a_space(tmp_path):
    (tmp_path / "my project").mkdir()
    shutil.copy(PROJECT / "Makefile", tmp_path / "my project")
    result = subprocess.run(["make"], cwd=tmp_path / "my project", env=environment(), text=True,
                            capture_output=True)
    assert "has a space" in refused(result)


# ---- a .pov file by itself -----------------------------------------------------------------------

def test_pov_files_render_by_themselves(original, tmp_path):
    """Plain POV-Ray, from another folder, without the project's include paths."""
    files = sorted(original.build.pov.glob("*.pov"))
    assert [file.stem for file in files] == FOG_RUNS
    for file in files:
        made = read_map(original.build.runs / f"{file.stem}.exr")
        height, width = made.shape[:2]
        image = tmp_path / f"{file.stem}.exr"
        subprocess.run(["povray", str(file), f"+O{image}", "+FE", f"+W{width}", f"+H{height}", "-A", "-D"],
                       cwd=tmp_path, check=True, capture_output=True, timeout=120, stdin=subprocess.DEVNULL)
        assert np.array_equal(read_map(image), made), file.name


# ---- interruptions -------------------------------------------------------------------------------

def leftovers(folder: Path) -> list[Path]:
    return [*folder.rglob("*.partial*"), *folder.rglob(".render-*")]


def different(one: TinyScene, other: TinyScene) -> list[str]:
    """Results that are not the same bit for bit, apart from the time that an EXR's header states."""
    def content(path):
        if path.suffix != ".exr":
            return path.read_bytes()
        return read_map(path).tobytes(), {k: v for k, v in read_metadata(path).items() if k != "DateTime"}

    return [name for name in RESULTS if content(one.build.out / name) != content(other.build.out / name)]


def processes_naming(folder: Path) -> list[str]:
    """Command lines of processes at work in a folder."""
    found = []
    for entry in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            command = entry.read_bytes().replace(b"\0", b" ").decode(errors="replace")
        except OSError:
            continue  # ended meanwhile
        if str(folder) in command:
            found.append(command)
    return found


def in_a_group(command: list[str]) -> subprocess.Popen:
    return subprocess.Popen(command, cwd=PROJECT, env=environment(), start_new_session=True,
                            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def interrupted(scene: Made, ending: signal.Signals, seconds: float) -> bool:
    """Starts make in its own process group and ends the group after so long; False if it was done before."""
    process = in_a_group(scene.command("scene=tiny"))
    try:
        process.wait(seconds)
        return False
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, ending)
        process.wait(60)
        return True


def check_interruption(original: Made, scene: Made, ending: signal.Signals, share: float) -> bool:
    seconds = share * float((original.root / "seconds").read_text())
    hit = interrupted(scene, ending, seconds)
    scene.made()
    assert different(scene, original) == [], (ending, share)
    assert leftovers(scene.root) == []
    assert processes_naming(scene.root) == []
    assert scene.would_run() == []
    return hit


@pytest.mark.parametrize("ending, share", [(signal.SIGINT, 0.35), (signal.SIGKILL, 0.6)],
                         ids=["SIGINT", "SIGKILL"])
def test_interrupted(ending, share, original, fresh):
    check_interruption(original, fresh, ending, share)


@pytest.mark.slow
@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL], ids=lambda s: s.name)
def test_interrupted_at_many_moments(ending, original, tmp_path):
    """Eight moments, one drawn from each eighth of an undisturbed run."""
    draw, hits = random.Random(ending), 0
    for number in range(8):
        scene = Made(tmp_path / str(number))
        write_tiny(scene.folder)
        hits += check_interruption(original, scene, ending, (number + draw.random()) / 8)
    assert hits >= 6, "most moments must fall into the run, or nothing was tested"


@pytest.mark.slow
@pytest.mark.parametrize("ending", [signal.SIGTERM, signal.SIGKILL], ids=lambda s: s.name)
def test_interrupted_change(ending, original, tmp_path):
    """Another fog, interrupted, and then the first fog again: nothing of the other remains."""
    draw = random.Random(ending)
    for number in range(4):
        scene = Made(tmp_path / str(number))
        for part in ("scenes", "build"):
            shutil.copytree(original.root / part, scene.root / part)
        process = in_a_group(scene.command("scene=tiny", "fog.visibility=3"))
        time.sleep((number + draw.random()) / 4 * 0.7 * float((original.root / "seconds").read_text()))
        if process.poll() is None:
            os.killpg(process.pid, ending)
        process.wait(60)
        scene.made()
        assert different(scene, original) == [], number
        assert leftovers(scene.root) == []


def test_leftovers_of_a_killed_run_are_removed(scene):
    partial, folder = scene.build.out / ".maps.1a2b3c4d.partial.json", scene.build.runs / ".render-x1y2z3"
    partial.write_text("{")
    (folder / ".povray").mkdir(parents=True)
    scene.made()
    assert leftovers(scene.root) == []


# ---- two at a time -------------------------------------------------------------------------------

def test_two_at_the_same_time(scene):
    """They want different fogs in one folder: one waits, says so, and its fog stands there in the end."""
    wanted = {"3": None, "4": None}
    for visibility in wanted:
        wanted[visibility] = subprocess.Popen(
            scene.command(str(scene.build.maps), "scene=tiny", f"fog.visibility={visibility}"),
            cwd=PROJECT, env=environment(), text=True,
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    said = {visibility: process.communicate(timeout=300)[1] for visibility, process in wanted.items()}
    assert [process.returncode for process in wanted.values()] == [0, 0], said
    line = f"waiting: another make is at work in {scene.build.shared}"
    waited = [visibility for visibility, text in said.items() if line in text]
    assert len(waited) == 1
    last = waited[0]
    assert read_json(scene.build.input("fog"))["visibility"] == float(last)
    stated = read_metadata(scene.build.transmittance)["fog:scattering_coefficient_per_m"][0]
    assert stated == pytest.approx(-np.log(0.05) / float(last), rel=1e-6), "float32 in the file's header"
    assert scene.redone_for(f"fog.visibility={last}") == ["composite", "report"], "which were not asked for"
    assert leftovers(scene.root) == []


# ---- the user study ----------------------------------------------------------------------------

def test_study_makes_what_it_shows_and_a_page(scene):
    """From the description to the page: a fog that was removed is made anew, another that is there stays."""
    scenes, made = scene.root / "scenes", scene.root / "build"
    shutil.copy(scenes / "tiny/photograph.png", scenes / "real.png")
    (scenes / "study.yaml").write_text("stimuli:\n  one: {scene: tiny, real: real.png}\n")
    before = (made / "tiny/foggy.exr").stat().st_mtime_ns
    result = scene.make("study")
    assert result.returncode == 0, result.stderr
    assert (made / "tiny/foggy.exr").stat().st_mtime_ns == before and stages(result.stderr) == []
    assert {path.name for path in (made / "study").iterdir()} == {"study.html", "study.json", "stimuli.png"}
    (made / "tiny/foggy.exr").unlink()
    result = scene.make("study")
    assert result.returncode == 0 and stages(result.stderr) == ["composite"]


@pytest.mark.parametrize("arguments, told", [
    (("study", "scene=tiny"), "leave out scene=tiny"), (("study", "fog.visibility=3"), "leave out fog.visibility"),
    (("scene=tiny", "simulate=3"), "are for make study"), (("study-results", "simulate=x"), "give a whole number"),
    (("study", "study=a b.yaml"), "study='a b.yaml'"), (("study-results", "answers=$(shell id)"), "answers="),
    (("study", "study=none.yaml"), "none.yaml: no such study file"), (("study-truth", "scene=tiny", "fogs=thick"), "has no model/foggy.py")])
def test_what_is_no_study_is_refused(arguments, told, scene):
    assert told in refused(scene.make(*arguments))
