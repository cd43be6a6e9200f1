"""What a person can do wrong, through the command line: one line that helps, and nothing half-written."""

from __future__ import annotations

import errno
import json
import os
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import imagecodecs
import numpy as np
import pytest

from pipeline.cli import STAGES, main
from pipeline.rendering import povray
from tests.conftest import TINY

PROJECT = Path(__file__).resolve().parent.parent
#: Stages up to the first that calls POV-Ray.
BEFORE_RENDERS = ("resolve", "photograph", "camera", "geometry", "sun_direction")
PROGRESS = re.compile(rf"({'|'.join(STAGES)}): |  ")

SUN = """\
  sun:
    type: sun
    irradiance: [1, 1, 1]
    openings:
      window:
        window: {points: [[-2, 1, -3], [-2, 2, -3], [-2, 2, -2], [-2, 1, -2]]}
        patches:
          - points: [[-1, 0, -3], [0, 0, -3], [0, 0, -2], [-1, 0, -2]]
"""
TABLE = """\
  table:
    type: cuboid
    stands_on: room.floor
    corners:
      front_left_bottom: [6, 16]
      front_right_bottom: [12, 16]
      front_left_top: [6, 12]
"""
ROOM = "    lower: [-2, 0, -5]\n    upper: [2, 2.5, 1]\n"
CAMERA = "  horizontal_field_of_view: 70\n  position: [0, 1.2, 0]\n  look_at: [0, 1.2, -5]\n"
LAMP_POINTS = "points: [[-0.4, 2.49, -3.4], [0.4, 2.49, -3.4], [0.4, 2.49, -2.6], [-0.4, 2.49, -2.6]]"
VISIBILITY = "visibility: 6"


def refusal(status: int, err: str, root: Path) -> str:
    """The one line that was said, after checks that hold for every mistake."""
    lines = err.splitlines()
    said = [line for line in lines if not PROGRESS.match(line)]
    assert status == 2
    assert len(said) == 1 and said[0].startswith("error: ") and lines[-1] == said[0], err
    assert "Traceback" not in err
    assert "; " in said[0], "a remedy follows the problem"
    for path in root.rglob("*"):
        assert ".partial" not in path.name and not path.name.startswith(".render-"), f"left behind: {path}"
        if (root / "build") in path.parents and path.is_file():
            assert path.stat().st_size > 0, f"empty: {path}"
    return said[0].removeprefix("error: ")


def lamp(inside: str) -> str:
    """The lamp's outline on a plane, by pixels."""
    return f"on: {inside.partition('|')[0]}\n      pixels: {inside.partition('|')[2]}"


@dataclass
class Edit:
    """An edit of the scene file, the words at whose line the mistake is, and words that the message holds."""

    id: str
    old: str
    new: str
    at: str
    says: tuple[str, ...]


EDITS = [
    Edit("broken YAML", "position: [0, 1.2, 0]", "position: [0, 1.2, 0", "look_at", ("not valid YAML",)),
    Edit("tabs", "  type: homogeneous", "\ttype: homogeneous", "\ttype: homogeneous",
         ("not valid YAML", "spaces instead of tabs")),
    Edit("YAML tag", VISIBILITY, "visibility: !!python/object/apply:os.system [touch owned]", "os.system",
         ("YAML tag", "!!python/object/apply:os.system", "plain values")),
    Edit("alias", "radiance: [4, 4, 4]", "radiance: *strength\nx: &strength [4, 4, 4]", "*strength",
         ("not valid YAML", "strength")),
    Edit("anchor used twice", "  position: [0, 1.2, 0]\n  look_at: [0, 1.2, -5]",
         "  position: &here [0, 1.2, 0]\n  look_at: *here", "look_at", ("alias", "write the values out")),
    Edit("merge key", "  type: homogeneous\n", "  <<: {visibility: 3}\n  type: homogeneous\n", "<<",
         ("'<<' is not a plain name",)),
    Edit("repeated key", VISIBILITY, "visibility: 6\n  visibility: 7", "visibility: 7",
         ("'visibility' is stated twice", "first in line 26")),
    Edit("unknown top-level key", "render:", "renderer:", "renderer:",
         ("renderer: unknown key", "did you mean 'render'", "use one of photograph, camera")),
    Edit("misspelt key", VISIBILITY, "visibilty: 6", "visibilty",
         ("fog.visibilty: unknown key", "did you mean 'visibility'")),
    Edit("misspelt key deep in a list", LAMP_POINTS, "pionts: [[0, 0, 0]]", "pionts",
         ("lights.lamp.outline.pionts: unknown key", "did you mean 'points'")),
    Edit("unknown light", "type: area", "type: aera", "aera",
         ("lights.lamp.type", "'aera'", "did you mean 'area'", "point, sky, spot, sun")),
    Edit("unknown shape", "type: room", "type: sphere", "sphere",
         ("shapes.room.type", "'sphere'", "use one of cuboid, mesh, polygon, room")),
    Edit("unknown medium", "fog:\n  type: homogeneous", "fog:\n  type: homogenous", "homogenous",
         ("fog.type", "did you mean 'homogeneous'")),
    Edit("unknown phase function", "type: isotropic", "type: mie", "mie",
         ("fog.phase_function.type", "'mie'", "henyey_greenstein, isotropic, rayleigh")),
    Edit("unknown estimator", "render:", "illumination: {type: guess}\nrender:", "guess",
         ("illumination.type", "'guess'", "use one of karsch, liu_xing, manual")),
    Edit("estimator of something else", "render:", "sun_direction: {type: karsch}\nrender:", "karsch",
         ("sun_direction.type", "'karsch'", "window_patches")),
    Edit("type missing", "    type: area\n", "", "lamp:",
         ("lights.lamp: 'type' is missing", "area, ", "point, sky, spot, sun")),
    Edit("required key missing", "    outline:\n      " + LAMP_POINTS + "\n", "", "lamp:",
         ("lights.lamp: 'outline' is missing",)),
    Edit("required part missing", CAMERA, "", "camera:", ("camera = None", "group")),
    Edit("no lights", TINY[TINY.index("lights:"):TINY.index("fog:")], "lights: {}\n", "lights:",
         ("lights = {}", "at least 1")),
    Edit("visibility below 0", VISIBILITY, "visibility: -3", "visibility",
         ("fog.visibility = -3", "0.001 or more [m]")),
    Edit("visibility not a number", VISIBILITY, "visibility: .nan", "visibility",
         ("fog.visibility = nan", "[m]")),
    Edit("unit written out", VISIBILITY, "visibility: 6 m", "visibility",
         ("fog.visibility = '6 m'", "give a number [m]")),
    Edit("number in quotes", VISIBILITY, 'visibility: "6"', "visibility",
         ("fog.visibility = '6'", "give a number [m]")),
    Edit("true for a number", VISIBILITY, "visibility: true", "visibility",
         ("fog.visibility = True", "give a number [m]")),
    Edit("asymmetry out of bounds", "type: isotropic", "type: henyey_greenstein\n    asymmetry: 1.5",
         "asymmetry",
         ("fog.phase_function.asymmetry = 1.5", "0.999 or less")),
    Edit("albedo above 1", VISIBILITY, "visibility: 6\n  single_scattering_albedo: [1, 2, 1]", "albedo",
         ("fog.single_scattering_albedo.1 = 2", "1.0 or less")),
    Edit("two channels", "radiance: [4, 4, 4]", "radiance: [4, 4]", "radiance",
         ("lights.lamp.radiance = [4, 4]", "at least 3 entries, not 2")),
    Edit("infinite radiance", "radiance: [4, 4, 4]", "radiance: [4, .inf, 4]", "radiance",
         ("lights.lamp.radiance.1 = inf", "[photo unit]")),
    Edit("visibility and coefficients", VISIBILITY, "visibility: 6\n  scattering_coefficient: [1, 1, 1]",
         "fog:",
         ("fog: both 'visibility' and a coefficient", "keep either")),
    Edit("one coefficient alone", VISIBILITY, "scattering_coefficient: [1, 1, 1]", "fog:",
         ("nothing says how dense", "[1/m]")),
    Edit("value of another way", VISIBILITY,
         "scattering_coefficient: [1, 1, 1]\n  absorption_coefficient: [0, 0, 0]\n"
         "  contrast: koschmieder", "contrast", ("fog.contrast", "no meaning beside coefficients")),
    Edit("name with a space", "  bulb:", "  my bulb:", "my bulb",
         ("lights.my bulb = 'my bulb'", "beginning with a letter")),
    Edit("choice misspelt", VISIBILITY, "visibility: 6\n  contrast: wmo", "contrast",
         ("fog.contrast = 'wmo'", "'meteorological_optical_range' or 'koschmieder'")),
    Edit("number or word", CAMERA, CAMERA + "  principal_point: middle\n", "principal_point",
         ("camera.principal_point = 'middle'", "'estimate'", "list")),
    Edit("polygon with two points", LAMP_POINTS, "points: [[0, 2.4, -3], [1, 2.4, -3]]", "points:",
         ("lights.lamp.outline.points", "at least 3 entries, not 2")),
    Edit("collinear polygon", LAMP_POINTS, "points: [[0, 2, -3], [1, 2, -3], [2, 2, -3]]", "lamp:",
         ("lamp.outline", "on one line")),
    Edit("self-crossing polygon", LAMP_POINTS, "points: [[0, 2, -3], [1, 2, -2], [1, 2, -3], [0, 2, -2]]",
         "lamp:",
         ("lamp.outline", "edges cross", "in order round the outline")),
    Edit("polygon off its plane", LAMP_POINTS, "points: [[0, 2, -3], [1, 2, -3], [1, 1, -2], [0, 2, -2]]",
         "lamp:", ("off a common plane",)),
    Edit("patch above the horizon", LAMP_POINTS, lamp("room.floor|[[4, 2], [10, 2], [7, 5]]"), "lamp:",
         ("room.floor", "horizon", "pixel (4, 2)")),
    Edit("unknown plane", LAMP_POINTS, lamp("room.cieling|[[4, 2], [10, 2], [7, 5]]"), "lamp:",
         ("'room.cieling'", "did you mean 'room.ceiling'")),
    Edit("pixels without plane", LAMP_POINTS, "pixels: [[4, 2], [10, 2], [7, 5]]", "outline",
         ("'on' and 'pixels' go together",)),
    Edit("position without depth", "      point: [1.2, 1.4, -4]", "      pixel: [12, 4]", "    position:",
         ("lights.bulb.position", "'depth', 'on' and 'above'")),
    Edit("cuboid with too few corners", "lights:", TABLE + "lights:", "table:",
         ("table", "do not determine")),
    Edit("cuboid with contradictory corners", "lights:",
         TABLE + "      front_right_top: [3, 17]\n      back_left_top: [20, 13]\nlights:", "table:",
         ("table: the width", "conflict", "left and right are not swapped")),
    Edit("cuboid with an unknown corner", "lights:", TABLE + "      front_left_topp: [3, 17]\nlights:",
         "table:",
         ("table", "'front_left_topp'", "front_left_top")),
    Edit("cuboid annotated and measured", "lights:",
         TABLE + "    centre: [0, 0.5, -3]\n    size: [1, 1, 1]\nlights:", "table:",
         ("shapes.table", "both")),
    Edit("room without enough annotation", ROOM, "    corners: {back_left_floor: [3, 14]}\n", "room:",
         ("do not determine",)),
    Edit("room upside down", ROOM, "    lower: [-2, 3, -5]\n    upper: [2, 2.5, 1]\n", "room:",
         ("lower", "upper", "every axis")),
    Edit("room by half", ROOM, "    lower: [-2, 0, -5]\n", "room:", ("only one of 'lower' and 'upper'",)),
    Edit("room annotated and measured", ROOM, ROOM + "    corners: {back_left_floor: [3, 14]}\n", "room:",
         ("both annotated and measured",)),
    Edit("camera without scale", CAMERA, "  horizontal_field_of_view: 70\n", "camera:",
         ("camera: no scale", "'height' [m]")),
    Edit("camera told twice", CAMERA, CAMERA + "  height: 1.5\n", "camera:",
         ("camera:", "'height'", "leave")),
    Edit("no focal length", CAMERA, "  height: 1.2\n", "camera:", ("focal length", "lines")),
    Edit("degenerate lines", CAMERA, "  height: 1.2\n  lines:\n    x: [[[3, 3], [3, 3]], [[4, 9], [9, 9]]]\n"
         "    z: [[[3, 3], [5, 5]], [[3, 15], [5, 13]]]\n", "camera:", ("line", "(3, 3)")),
    Edit("position is look_at", "look_at: [0, 1.2, -5]", "look_at: [0, 1.2, 0]", "camera:",
         ("[0.0, 1.2, 0.0]", "look somewhere else")),
    Edit("look_at alone", "  position: [0, 1.2, 0]\n", "", "camera:",
         ("only one of 'position' and 'look_at'",)),
    Edit("spot inside out", "    type: point\n",
         "    type: spot\n    target: {point: [0, 0, -3]}\n    inner_angle: 40\n", "bulb:",
         ("inner_angle 40", "outer_angle 30")),
    Edit("direction of no length", "fog:\n", SUN + "    direction: [0, 0, 0]\nfog:\n", "direction:",
         ("points nowhere",)),
    Edit("sun from behind the wall", "fog:\n", SUN + "    direction: [-1, -0.5, 0]\nfog:\n", "sun:",
         ("window", "does not enter")),
    Edit("two suns", "fog:\n", SUN + SUN.replace("sun:", "sun2:", 1) + "fog:\n", "lights:",
         ("more than one light of type sun", "openings")),
    Edit("patch that no sun explains", "fog:\n",
         SUN.replace("[[-1, 0, -3], [0, 0, -3], [0, 0, -2], [-1, 0, -2]]",
         "[[-1.8, 2.4, 0.8], [1.8, 2.4, 0.8], [1.8, 2.4, -4.5], [-1.8, 2.4, -4.5]]") + "fog:\n", "sun:",
         ("no sun direction explains",)),
    Edit("manual without strengths", "    radiance: [4, 4, 4]\n", "", "lamp:",
         ("lights.lamp: no radiance", "manual", "radiance:")),
    Edit("photograph outside by ..", "photograph.png", "../../photograph.png", "file:",
         ("'../../photograph.png'", "out of the scene's folder")),
    Edit("photograph by an absolute name", "photograph.png", "/etc/passwd", "file:",
         ("'/etc/passwd'", "out of the scene's folder")),
    Edit("photograph missing", "photograph.png", "photo.png", None,
         ("photo.png: no such file", "scene.yaml:2")),
    Edit("photograph is text", "photograph.png", "scene.yaml", None,
         ("scene.yaml: not a readable image", "JPEG, PNG, TIFF, EXR or HDR")),
    Edit("photograph is a folder", "photograph.png", ".", None, ("cannot be read", "directory")),
    Edit("photograph too large", "  file: photograph.png", "  file: photograph.png\n  max_megapixels: 0.0001",
         None,
         ("photograph.png: 24 x 18", "max_megapixels")),
    Edit("fSpy file missing", CAMERA, "  height: 1.2\n  fspy: camera.json\n", None,
         ("camera.json: no such file", "scene.yaml:5")),
]


@pytest.mark.parametrize("edit", EDITS, ids=lambda edit: edit.id)
def test_scene_file(edit, tiny_scene, capsys):
    if edit.id == "manual without strengths":
        tiny_scene.replace("render:", "illumination: {type: manual}\nrender:")
    tiny_scene.replace(edit.old, edit.new)
    message = refusal(tiny_scene.run(*BEFORE_RENDERS), capsys.readouterr().err, tiny_scene.root)
    if edit.at is not None:
        assert message.startswith(f"{tiny_scene.file}:{tiny_scene.line(edit.at)}: "), message
    for words in edit.says:
        assert words in message
    assert not Path("owned").exists()


@pytest.mark.parametrize("content, says", [
    (b"", ("the scene file is empty",)),
    (b"# nothing yet\n", ("the scene file is empty",)),
    (b"- photograph\n- camera\n", (":1: ", "not a group")),
    (b"just words", (":1: ", "not a group")),
    (b"a: 1\n---\nb: 2\n", (":2: ", "not valid YAML")),
    (b"\xff\xfe\x00", ("cannot be read", "UTF-8")),
    (b"a: '\x01'", ("not valid YAML", "control characters")),
    (b"a: " + b"[" * 1500 + b"]" * 1500, ("nested too deeply",)),
    (b"a: " + b"9" * 5000, ("not valid YAML",)),
    (b"? [1, 2]\n: 3\n", (":1: ", "a group as a name")),
    (b"#" * 3_000_000, ("3000000 bytes", "below 2000000 bytes")),
], ids=["empty", "only a comment", "list", "words", "two documents", "not UTF-8", "control characters",
        "deep", "huge number",
        "list as a name", "too large"])
def test_scene_file_that_is_none(content, says, tiny_scene, capsys):
    tiny_scene.file.write_bytes(content)
    message = refusal(tiny_scene.run("resolve"), capsys.readouterr().err, tiny_scene.root)
    assert message.startswith(str(tiny_scene.file))
    for words in says:
        assert words in message
    assert not (tiny_scene.root / "build").exists()


def test_missing_scene_file(tiny_scene, capsys):
    tiny_scene.file.unlink()
    message = refusal(tiny_scene.run("resolve"), capsys.readouterr().err, tiny_scene.root)
    assert "scene.yaml: no such scene file; write " in message


def test_how_many_more(tiny_scene, capsys):
    tiny_scene.replace(VISIBILITY, "visibility: -1")
    tiny_scene.replace("samples: 8", "samples: 0")
    tiny_scene.replace("sub_lights: 2", "sub_lights: 2.5")
    message = refusal(tiny_scene.run("resolve"), capsys.readouterr().err, tiny_scene.root)
    # the first in the file
    assert "lights.lamp.sub_lights = 2.5 (and 2 more); give a whole number" in message


@pytest.mark.parametrize("name, says", [
    ("a/b", ("scene name 'a/b'", "without slashes")),
    ("../tiny", ("scene name '../tiny'", "without slashes")),
    ("..", ("scene name '..'",)),
    ("", ("no scene is named", "make scene=bathroom")),
    ("tiny\n", ("scene name 'tiny '",)),
    ("$(id)", ("scene name '$(id)'",)),
    ("inputs", ("scene name 'inputs'", "none of")),
    ("tinny", ("no scene is called 'tinny'", "use one of tiny", "did you mean 'tiny'")),
])
def test_scene_name(name, says, tiny_scene, capsys):
    message = refusal(tiny_scene.run("resolve", scene=name), capsys.readouterr().err, tiny_scene.root)
    for words in says:
        assert words in message
    assert not (tiny_scene.root / "build").exists()


@pytest.mark.parametrize("fog, says", [
    ("thik", ("no fog is called 'thik'", "did you mean 'thick'")),
    ("../x", ("fog name '../x'", "command line")),
    ("runs", ("fog name 'runs'", "none of")),
])
def test_fog_name(fog, says, tiny_scene, capsys):
    message = refusal(tiny_scene.run("resolve", fog=fog), capsys.readouterr().err, tiny_scene.root)
    for words in says:
        assert words in message


@pytest.mark.parametrize("override, says", [
    ("fog.visibility", ("'fog.visibility' is no KEY=VALUE", "write fog.visibility=3")),
    ("=3", ("'=3' is no KEY=VALUE",)),
    ("fog.visibility=-3", ("fog.visibility = -3", "0.001 or more [m]")),
    ("fog.visibility=3m", ("fog.visibility = '3m'", "a number [m]")),
    ("fog.visibility=[3", ("fog.visibility=[3 is not a value",)),
    ("fog.visibility=!!python/name:os.system", ("fog.visibility=!!python/name:os.system is not a value",)),
    ("fog.visibilty=3", ("fog.visibilty: unknown key", "did you mean 'visibility'")),
    ("fgo.visibility=3", ("the scene has no 'fgo'", "did you mean 'fog'")),
    ("lights.lmap.gain=2", ("lights has no 'lmap'", "use one of bulb, lamp", "did you mean 'lamp'")),
    ("lights.lamp.gain.x=2", ("lights.lamp.gain is a value, not a group",)),
    ("fog.visibility.x=2", ("fog.visibility is a value, not a group",)),
    ("lights.lamp.outline.points.9.0=2",
     ("lights.lamp.outline.points has 4 entries, none numbered '9'", "from 0 to 3")),
    ("render.samples=2.5", ("render.samples = 2.5", "a whole number")),
])
def test_override(override, says, tiny_scene, capsys):
    message = refusal(tiny_scene.run("resolve", overrides=(override,)), capsys.readouterr().err,
                      tiny_scene.root)
    assert message.startswith("command line: ")
    for words in says:
        assert words in message


def test_override_that_contradicts_the_file_names_both(tiny_scene, capsys):
    status = tiny_scene.run("resolve", overrides=("fog.scattering_coefficient=[1,1,1]",))
    message = refusal(status, capsys.readouterr().err, tiny_scene.root)
    line = tiny_scene.line("fog:")
    assert message.startswith(f"command line, {tiny_scene.file}:{line}: fog: both 'visibility'")


@pytest.mark.parametrize("arguments, says", [
    (["reslove", "--scene", "tiny"], "invalid choice: 'reslove'"),
    (["resolve", "--sceen", "tiny"], "unrecognized arguments: --sceen"),
    ([], "COMMAND"),
])
def test_command_line(arguments, says, tiny_scene, capsys):
    message = refusal(main(arguments), capsys.readouterr().err, tiny_scene.root)
    assert message.startswith("command line: ") and says in message and "--help" in message


# ---- photographs ---------------------------------------------------------------------------------

def _truncated(path: Path) -> None:
    path.write_bytes(imagecodecs.png_encode(np.random.default_rng(0).integers(0, 255, (18, 24, 3),
                                                                              np.uint8))[:700])


def _symlink(path: Path) -> None:
    outside = path.parents[2] / "elsewhere.png"
    path.rename(outside)
    path.symlink_to(outside)


@pytest.mark.parametrize("spoil, says", [
    (_truncated, ("truncated or damaged", "copy the photograph again")),
    (lambda path: path.write_bytes(b""), ("empty (0 bytes)",)),
    (lambda path: path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"x" * 100), ("photograph.png: ",)),
    (_symlink, ("out of the scene's folder",)),
], ids=["truncated", "empty", "garbage after the signature", "symbolic link outwards"])
def test_photograph(spoil, says, tiny_scene, capsys):
    spoil(tiny_scene.folder / "photograph.png")
    message = refusal(tiny_scene.run("resolve", "photograph"), capsys.readouterr().err, tiny_scene.root)
    for words in says:
        assert words in message
    assert not tiny_scene.build.photograph.exists()


FSPY = {"principalPoint": {"x": 0, "y": 0}, "horizontalFieldOfView": 1.2, "imageWidth": 24, "imageHeight": 18,
        "cameraTransform": {"rows": [[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 1.5], [0, 0, 0, 1]]}}


@pytest.mark.parametrize("content, says", [
    ("{", "is not JSON"),
    (json.dumps({"imageWidth": 24}), "is missing"),
    (json.dumps({**FSPY, "imageWidth": 48}), "48x18 pixels, the photograph 24x18"),
], ids=["broken", "incomplete", "of another size"])
def test_fspy(content, says, tiny_scene, capsys):
    (tiny_scene.folder / "camera.json").write_text(content)
    tiny_scene.replace(CAMERA, "  height: 1.2\n  fspy: camera.json\n")
    message = refusal(tiny_scene.run("resolve", "photograph", "camera"), capsys.readouterr().err,
                      tiny_scene.root)
    assert says in message and "camera.json" in message.split("; ")[0]


# ---- templates and POV-Ray -----------------------------------------------------------------------

def _up_to_illumination(scene) -> int:
    return scene.run(*BEFORE_RENDERS, "illumination")


@pytest.mark.parametrize("name, content, line, says", [
    ("lights/area.inc", "// a lamp\nlight_sorce { <0,1,0> rgb 1 }\n", 2,
     ("POV-Ray: ", "light_sorce", "irradiance_lamp.log")),
    ("lights/area.inc", "// a lamp\nlight_source { <0,1,0> rgb << radiance | vectr >> }\n", 2, ("vectr",)),
    ("lights/area.inc", "// a lamp\n\n<% for cell in cells %>\n", 3, ("does not parse",)),
    ("lights/area.inc", "// a lamp\n<< radius >>\n", 2, ("'radius' is undefined",)),
    ("lights/area.inc", "// a lamp\n<< radiance / 2 >>\n", 2, ("template fails",)),
    ("lights/area.inc", "<% include '../../../../etc/passwd' %>\n", None,
     ("no template '../../../../etc/passwd'",)),
    ("lights/area.inc", "<% include '/etc/passwd' %>\n", None, ("no template '/etc/passwd'",)),
    ("lights/area.inc", "// x\n<< ''.__class__.__mro__[1].__subclasses__() >>\n", 2, ("unsafe", "__class__")),
    ("lights/area.inc", "// x\n<< cells.__init__.__globals__ >>\n", 2, ("unsafe",)),
    ("lights/area.inc", "// x\n<% for i in range(999999999) %>x<% endfor %>\n", 2, ("range",)),
    ("lights/area.inc", '// x\n#include "/etc/passwd"\n', 2, ("'include' lets the scene open files",)),
    ("lights/area.inc", '/* /* */ // */ #/**/include concat("/etc/", "passwd")\n', 1, ("'include' lets",)),
    ("lights/area.inc", '#fopen F "owned" write\n#write (F, "x")\n', 1,
     ("'fopen' lets the scene open files",)),
    ("lights/area.inc", '#include "strings.inc"\nParse_String("...")\n', 1,
     ("'include' lets", '"colors.inc"')),
    ("irradiance.pov", "nonsense\n", 1, ("POV-Ray: ",)),
], ids=["POV-Ray syntax", "unknown filter", "loop without end", "unknown value", "wrong operation",
        "include outside",
        "include absolute", "code execution", "code execution by globals", "endless loop",
        "POV-Ray reads outside",
        "POV-Ray reads outside, disguised", "POV-Ray writes", "POV-Ray writes by its library",
        "whole scene replaced"])
def test_template(name, content, line, says, tiny_scene, capsys):
    template = tiny_scene.folder / name
    template.parent.mkdir(exist_ok=True)
    template.write_text(content)
    message = refusal(_up_to_illumination(tiny_scene), capsys.readouterr().err, tiny_scene.root)
    assert message.startswith(f"{template}:{line}: " if line else str(template)), message
    for words in says:
        assert words in message
    assert "root:" not in message and not list(tiny_scene.root.rglob("owned"))
    assert not list(tiny_scene.build.basis.glob("*_lamp.exr"))


def test_log_tells_the_command(tiny_scene, capsys):
    (tiny_scene.folder / "lights").mkdir()
    (tiny_scene.folder / "lights" / "area.inc").write_text("nonsense\n")
    message = refusal(_up_to_illumination(tiny_scene), capsys.readouterr().err, tiny_scene.root)
    log = Path(re.search(r"see (\S+\.log)", message).group(1))
    assert log.read_text().startswith("command: ") and "irradiance_lamp.pov" in log.read_text()


@pytest.fixture
def fresh_povray():
    """POV-Ray looked up anew, before and after."""
    for cached in (povray.program, povray.version):
        cached.cache_clear()
    yield
    for cached in (povray.program, povray.version):
        cached.cache_clear()


@pytest.mark.parametrize("script, says", [
    (None, ("POV-Ray is not installed", "apt-get install povray")),
    ("#!/bin/sh\necho POV-Ray 3.8.0 >&2\n", ("version 3.8.0", "install POV-Ray 3.7")),
    ("#!/bin/sh\necho no idea\n", ("does not say its version",)),
    ('#!/bin/sh\n[ "$1" = --version ] && echo POV-Ray 3.7.0 && exit\nkill -SEGV $$\n',
     ("signal SIGSEGV", "basis/irradiance_", ".log")),  # of lights rendered side by side, either's
    ('#!/bin/sh\n[ "$1" = --version ] && echo POV-Ray 3.7.0 && exit\nexit 1\n',
     ("POV-Ray failed: it said nothing",)),
    ('#!/bin/sh\n[ "$1" = --version ] && echo POV-Ray 3.7.0 && exit\nexit 0\n',
     ("wrote no readable picture",)),
], ids=["missing", "another version", "another program", "crash", "silent failure", "no picture"])
def test_povray(script, says, tiny_scene, capsys, monkeypatch, fresh_povray):
    program = tiny_scene.root / "povray"
    if script:
        program.write_text(script)
        program.chmod(0o755)
    monkeypatch.setenv("POVRAY", str(program))
    message = refusal(_up_to_illumination(tiny_scene), capsys.readouterr().err, tiny_scene.root)
    for words in says:
        assert words in message
    assert not list(tiny_scene.build.basis.glob("*.exr"))


# ---- the machine ---------------------------------------------------------------------------------

def test_disk_full(tiny_scene, capsys, monkeypatch):
    assert tiny_scene.run("resolve") == 0

    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "replace", full)
    capsys.readouterr()
    message = refusal(tiny_scene.run("photograph"), capsys.readouterr().err, tiny_scene.root)
    assert "photograph.exr: cannot write the file: No space left on device; " in message
    assert "space" in message.split("; ")[1]
    assert not tiny_scene.build.photograph.exists()


def test_disk_full_while_making_folders(tiny_scene, capsys, monkeypatch):
    def full(path, *_, **__):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))

    monkeypatch.setattr(Path, "mkdir", full)
    message = refusal(tiny_scene.run("resolve"), capsys.readouterr().err, tiny_scene.root)
    assert "build" in message and "No space left on device; free some space" in message


@pytest.mark.parametrize("limit, stages, written", [
    (300, ("photograph",), "photograph.exr"),  # a picture of 24 x 18 takes more
    (2500, ("illumination",), "irradiance_lamp"),  # POV-Ray's half floats, or the .pov file before them
], ids=["our file", "POV-Ray's file"])
def test_no_room_for_a_file(limit, stages, written, tiny_scene, capsys):
    """The system itself refuses to write on, in the middle of a file."""
    assert tiny_scene.run(*(BEFORE_RENDERS if stages == ("illumination",) else ("resolve",))) == 0
    child = (f"import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, {limit}));"
             "from pipeline.cli import main; sys.exit(main(sys.argv[1:]))")
    done = subprocess.run(
        [sys.executable, "-c", child, *stages, "--scene", "tiny", "--scenes", str(tiny_scene.root / "scenes"),
         "--build", str(tiny_scene.root / "build")], cwd=PROJECT, capture_output=True, text=True, timeout=120)
    message = refusal(done.returncode, done.stderr, tiny_scene.root)
    assert written in message and ("space" in message or "disk" in message)
    assert not list((tiny_scene.root / "build").rglob(f"{written}*.exr"))


def test_build_folder_is_a_file(tiny_scene, capsys):
    (tiny_scene.root / "build").write_text("in the way")
    message = refusal(tiny_scene.run("resolve"), capsys.readouterr().err, tiny_scene.root)
    assert str(tiny_scene.root / "build") in message and "remove the file" in message


def test_build_folder_not_writable(tiny_scene, capsys, monkeypatch):
    if os.getuid() == 0:  # root may write everywhere, so that the system's refusal has to be acted
        def refused(path, *_, **__):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))

        monkeypatch.setattr(Path, "mkdir", refused)
    else:
        (tiny_scene.root / "build").mkdir(mode=0o500)
    message = refusal(tiny_scene.run("resolve"), capsys.readouterr().err, tiny_scene.root)
    assert "build" in message and "Permission denied; check that" in message


def test_stage_before_its_turn(tiny_scene, capsys):
    assert tiny_scene.run("resolve") == 0
    message = refusal(tiny_scene.run("camera"), capsys.readouterr().err, tiny_scene.root)
    assert "photograph.json: no such file; run the stages before this one" in message


@pytest.mark.parametrize("artefact, content, stage, says", [
    ("camera.json", "garbage", "geometry", "camera.json: cannot be read"),
    ("camera.json", "{}", "geometry", "camera.json: holds no"),
    ("inputs/shapes.json", '{"room": {"type": "room", "lower": 3}}', "geometry",
     "build folder: shapes of type 'room'"),
    ("inputs/shapes.json", '{"room": {"type": "gone"}}', "geometry", "build folder: shapes of type 'gone'"),
    ("depth.exr", "garbage", "decompose", "depth.exr: not a readable OpenEXR file"),
    ("photograph.json", "\x00\x01", "camera", "photograph.json: cannot be read"),
], ids=["garbage", "empty", "of another version", "of a plugin that is gone", "picture", "binary"])
def test_corrupt_artefact(artefact, content, stage, says, tiny_scene, capsys):
    assert tiny_scene.run(*BEFORE_RENDERS) == 0
    if stage == "decompose":
        assert tiny_scene.run("illumination", "plan", "emit", "render") == 0
    (tiny_scene.build.shared / artefact).write_text(content)
    capsys.readouterr()
    message = refusal(tiny_scene.run(stage), capsys.readouterr().err, tiny_scene.root)
    assert says in message and ("make again" in message or "run the pipeline again" in message)
