"""Scenes from strangers: nothing of theirs runs, nothing outside their folder is read, and what they cost is limited."""

from __future__ import annotations

import io
import os
import pickle
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import imagecodecs
import numpy as np
import OpenImageIO as oiio
import pytest

from pipeline.cli import main
from pipeline.errors import LONGEST, InputError
from pipeline.imaging import photograph as photographs
from pipeline.imaging.depth_file import read_labels
from pipeline.rendering import emit as emit_module, sandbox
from pipeline.rendering.emit import Templates
from pipeline.scene import load
from pipeline.scene.load import read_scene

BEFORE_RENDERS = ("resolve", "photograph", "camera", "geometry", "sun_direction")
SECRET = "secret-of-another-folder"
DEPTH = "depth:\n  regions:\n    ground: {class: support, pixels: [[0, 9], [24, 9], [24, 18], [0, 18]]}\n"


def refused(tiny, capsys, *stages: str, **options) -> str:
    """The one line in which the stages refuse the scene."""
    assert tiny.run(*(stages or BEFORE_RENDERS), **options) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert error.startswith("error: ") and "; " in error and error.isprintable() and len(error) < 1500
    assert SECRET not in error
    return error


# ---- nothing of theirs runs ----------------------------------------------------------------------

@pytest.mark.parametrize("payload", [
    "!!python/object/apply:os.system ['touch OWNED']", "!!python/object/new:os.system ['touch OWNED']",
    "!!python/name:os.system", "!!python/module:os", "!<tag:yaml.org,2002:python/object/apply:os.system> ['touch OWNED']",
    "!local x", "!!binary aGk=", "!!set {a, b}",
])
def test_yaml_tags_build_nothing(payload, tiny_scene, capsys, monkeypatch):
    monkeypatch.chdir(tiny_scene.root)
    tiny_scene.replace("file: photograph.png", f"file: {payload}")
    assert "YAML tag" in refused(tiny_scene, capsys, "resolve")
    assert not (tiny_scene.root / "OWNED").exists()


@pytest.mark.parametrize("code", ["<< 7 * 7 >>", "<% include '../../outside.inc' %>", "{{ 7 * 7 }}", "${HOME}", "$(touch OWNED)"])
def test_values_are_no_templates(code, tiny_scene, capsys, monkeypatch):
    """A value that reaches templates or messages stays the text that it is."""
    monkeypatch.chdir(tiny_scene.root)
    tiny_scene.replace("file: photograph.png", f"file: \"{code}\"")
    if "/" not in code:
        assert code in refused(tiny_scene, capsys, "resolve")
    else:
        refused(tiny_scene, capsys, "resolve")
    assert not (tiny_scene.root / "OWNED").exists()


def test_names_are_no_templates(tiny_scene, capsys):
    tiny_scene.replace("  bulb:", "  \"<< 7 * 7 >>\":")
    assert "a name of letters" in refused(tiny_scene, capsys, "resolve")


def test_pickled_grid_is_not_unpickled(tiny_scene, capsys, monkeypatch):
    class Owned:
        def __reduce__(self):
            return os.system, ("touch OWNED",)

    monkeypatch.chdir(tiny_scene.root)
    stream = io.BytesIO()
    np.lib.format.write_array(stream, np.full((2, 2, 2), Owned(), object), allow_pickle=True)
    for data in (stream.getvalue(), pickle.dumps(Owned())):
        (tiny_scene.folder / "density.npy").write_bytes(data)
        status = tiny_scene.run("resolve", overrides=(
            "fog={type: grid, file: density.npy, visibility: 5, lower: [-1, 0, -4], upper: [1, 2, -1]}",))
        assert status == 0
        assert "density.npy: cannot be read" in refused(tiny_scene, capsys, "photograph", "camera", "geometry", "sun_direction",
                                                        "illumination", "plan")
    assert not (tiny_scene.root / "OWNED").exists()


@pytest.mark.parametrize("template, says", [
    ("<< ''.__class__.__mro__ >>", "unsafe"), ("<< ().__class__ >>", "unsafe"), ("<< range.__init__.__globals__ >>", "unsafe"),
    ("<< ''['__class__'].__mro__ >>", "unsafe"), ("<< '{0.__class__.__mro__}'.format('') >>", "unsafe"),
    ("<< ''|attr('__class__') >>", "unsafe"), ("<< self._TemplateReference__context >>", "unsafe"),
    ("<< cycler.__init__.__globals__.os >>", "unsafe"), ("<% import 'os' as x %>", "no template 'os'"),
    ("<% extends '../x' %>", "no template '../x'"), ("<< 'x' * 9999999 >>", "characters or entries at once"),
    ("<< 10 ** 10 ** 9 >>", "power beyond"), ("<< '%999999999d' % 1 >>", "formatted by %"),
    ("<% for i in range(10**6) %><% endfor %>", "range"),
])
def test_templates_stay_in_their_box(template, says, tmp_path):
    (tmp_path / "own.inc").write_text("// mine\n" + template + "\n")
    with pytest.raises(InputError, match=r"own\.inc|'os'|'\.\./x'") as raised:
        Templates(tmp_path).render("own.inc", {})
    assert says in str(raised.value)


@pytest.mark.parametrize("limit, value, says", [("MAX_SECONDS", 0.2, "longer than 0.2 s"), ("MAX_BYTES", 5000, "more than 5000 bytes")])
def test_templates_that_go_on(limit, value, says, tmp_path, monkeypatch):
    monkeypatch.setattr(sandbox, limit, value)
    (tmp_path / "own.inc").write_text("<% set r = range(99999) %><% for i in r %><% for j in r %><% if j < 1 %>xxxxxxx<% endif %>"
                                      "<% endfor %><% endfor %>" if limit == "MAX_SECONDS"
                                      else "<% for i in range(9999) %>xxxxxxx<% endfor %>")
    # stages work in the main thread, the annotation page's estimates in another
    with ThreadPoolExecutor(1) as pool:
        for filled in (lambda: Templates(tmp_path).render("own.inc", {}),
                       lambda: pool.submit(Templates(tmp_path).render, "own.inc", {}).result(timeout=60)):
            with pytest.raises(InputError, match="own.inc") as raised:
                filled()
            assert says in str(raised.value) and "this limit is fixed" in str(raised.value)
        (tmp_path / "own.inc").write_text("short")
        assert pool.submit(Templates(tmp_path).render, "own.inc", {}).result(timeout=60).endswith("short"), "no alarm is left"


def test_large_templates(tmp_path, monkeypatch):
    monkeypatch.setattr(emit_module, "MAX_TEMPLATE_BYTES", 100)
    (tmp_path / "own.inc").write_text("x" * 101)
    with pytest.raises(InputError, match="template of 101 bytes; keep it below 100 bytes; this limit is fixed"):
        Templates(tmp_path).render("own.inc", {})


# ---- nothing outside their folder is read --------------------------------------------------------

PLACES = {
    "photograph": ("file: photograph.png", "file: {}"),
    "labels": ("shapes:\n", "depth: {{labels: {}}}\nshapes:\n"),
    "map": ("shapes:\n", "depth: {{map: {{file: {}}}}}\nshapes:\n"),
    "fspy": ("  horizontal_field_of_view: 70\n  position: [0, 1.2, 0]\n  look_at: [0, 1.2, -5]\n", "  fspy: {}\n  height: 1\n"),
    "grid": ("fog:\n  type: homogeneous\n", "fog:\n  type: grid\n  file: {}\n  lower: [0, 0, 0]\n  upper: [1, 1, 1]\n"),
}


@pytest.mark.parametrize("way", ["../../outside.npy", "absolute", "link.npy", "linked/outside.npy", "photograph.png/../../../outside.npy"])
@pytest.mark.parametrize("place", PLACES)
def test_files_outside_the_scene(place, way, tiny_scene, capsys):
    outside = tiny_scene.root / "outside.npy"
    outside.write_text(SECRET)
    (tiny_scene.folder / "link.npy").symlink_to(outside)
    (tiny_scene.folder / "linked").symlink_to(tiny_scene.root)
    old, new = PLACES[place]
    tiny_scene.replace(old, new.format(str(outside) if way == "absolute" else way))
    message = refused(tiny_scene, capsys, "resolve")
    assert "leads out of the scene's folder" in message or way.startswith("photograph.png/")


@pytest.mark.parametrize("place", PLACES)
def test_pipes_are_not_waited_for(place, tiny_scene, capsys):
    os.mkfifo(tiny_scene.folder / "pipe.npy")
    old, new = PLACES[place]
    tiny_scene.replace(old, new.format("pipe.npy"))
    assert "'pipe.npy' is no plain file" in refused(tiny_scene, capsys, "resolve")


def test_scene_file_that_is_a_pipe(tmp_path):
    os.mkfifo(tmp_path / "scene.yaml")
    with pytest.raises(InputError, match="is no plain file"):
        read_scene(tmp_path / "scene.yaml")


def test_templates_that_are_links(tiny_scene, capsys):
    (tiny_scene.root / "outside.inc").write_text(f"// {SECRET}\n")
    (tiny_scene.folder / "area.inc").symlink_to(tiny_scene.root / "outside.inc")
    assert "leads out of the scene's folder" in refused(tiny_scene, capsys, "resolve")
    with pytest.raises(InputError, match="area.inc: a template that leads out of the scene's folder"):
        Templates(tiny_scene.folder).render("area.inc", {})


def test_a_scene_above_its_folder(tiny_scene, capsys):
    for name in ("..", ".", "../tiny", "/etc"):
        assert "scene name" in refused(tiny_scene, capsys, "resolve", scene=name)


# ---- what they cost is limited -------------------------------------------------------------------

def test_scene_file_limits(tmp_path, monkeypatch):
    monkeypatch.setattr(load, "MAX_BYTES", 1000)
    for text, says in (("a: [" + "1, " * 60 + "]", "more than 50 values in line 1; split the scene; this limit is fixed"),
                       ("a:\n  " + "[" * 49 + "{" + "[" * 3, "nested too deeply in line 2, more than 50 groups or lists"),
                       ("#" * 1001, "keep it below 1000 bytes"), ("a: &x [1]\nb: *x\n", "YAML alias"),
                       ("a: &x {b: 1}\nc: {<<: *x}\n", "merged ones")):
        (tmp_path / "scene.yaml").write_text(text)
        monkeypatch.setattr(load, "MAX_NODES", 500 if "[[" in text else 50)
        with pytest.raises(InputError) as raised:
            read_scene(tmp_path / "scene.yaml")
        assert says in str(raised.value)


POINTS = "points: [[-0.4, 2.49, -3.4], [0.4, 2.49, -3.4], [0.4, 2.49, -2.6], [-0.4, 2.49, -2.6]]"
LIMITS = [
    ("vertices", POINTS, "points: [" + "[0, 1, 2], " * 201 + "]", ("at most 200 entries, not 201", "this limit is fixed")),
    ("regions", "shapes:\n", "depth:\n  regions:\n" + "".join(
        f"    r{n}: {{class: sky, pixels: [[0, 0], [9, 0], [9, 9]]}}\n" for n in range(501)) + "shapes:\n",
     ("at most 500 entries, not 501", "this limit is fixed")),
    ("outline of a region", "shapes:\n", "depth: {regions: {r: {class: sky, pixels: [" + "[0, 1], " * 2001 + "]}}}\nshapes:\n",
     ("at most 2000 entries, not 2001", "this limit is fixed")),
    ("lamps", "  bulb:\n", "  many: {type: lamps, intensity: [1, 1, 1], positions: [" + "{point: [0, 1, 2]}, " * 5001
     + "]}\n  bulb:\n", ("at most 5000 entries, not 5001", "this limit is fixed")),
    ("lights", "  bulb:\n", "".join(f"  l{n}: {{type: ambient}}\n" for n in range(500)) + "  bulb:\n",
     ("at most 500 entries, not 502", "this limit is fixed")),
    ("sub_lights", "sub_lights: 2", "sub_lights: 33", ("sub_lights = 33", "32 or less")),
    ("small lights", "  bulb:\n", "".join(
        f"  l{n}: {{type: area, radiance: [1, 1, 1], sub_lights: 32, outline: {{{POINTS}}}}}\n" for n in range(20)) + "  bulb:\n",
     ("20485 small lights", "more than 20000", "lower sub_lights", "this limit is fixed")),
    ("fogs", "fogs:\n", "fogs:\n" + "".join(f"  f{n}: {{type: homogeneous, visibility: 2}}\n" for n in range(500)),
     ("at most 500 entries, not 501", "this limit is fixed")),
    ("samples", "samples: 8", "samples: 10001", ("samples = 10001", "10000 or less")),
    ("time", "samples: 8", "timeout: 86401", ("timeout = 86401", "86400.0 or less [s]")),
    ("megapixels", "file: photograph.png", "file: photograph.png\n  max_megapixels: 2001", ("max_megapixels", "2000.0 or less")),
    ("noise", "fog:\n  type: homogeneous\n", "fog:\n  type: noise\n  scale: 1\n  top_height: 1.0e+9\n", ("so fine a fog", "lower 'detail'")),
    ("mesh", "  room:\n", "  m: {type: mesh, vertices: [[0, 0, 0], [1, 0, 0], [0, 1, 0]], triangles: [[0, 1, 3]]}\n  room:\n",
     ("a triangle names vertex 3 of 3",)),
    ("coordinates", "visibility: 6", "type: height\n  scale_height: 2\n  base: 1.0e+308\n  visibility: 6", ("base = 1e+308", "1000000000.0 or less")),
    ("near 0", "position:\n      point: [1.2, 1.4, -4]", "radius: 1.0e-320\n    position:\n      point: [1.2, 1.4, -4]",
     ("radius", "1e-06 or more")),
]


@pytest.mark.parametrize("old, new, says", [one[1:] for one in LIMITS], ids=[one[0] for one in LIMITS])
def test_limits_of_values(old, new, says, tiny_scene, capsys):
    if "type: height" in new:
        tiny_scene.replace("  type: homogeneous\n  visibility: 6", "  visibility: 6")
    tiny_scene.replace(old, new)
    message = refused(tiny_scene, capsys, "resolve")
    for words in says:
        assert words in message, message


@pytest.mark.parametrize("override", ["photograph.max_megapixels=0.0004"])
def test_limit_of_pixels(override, tiny_scene, capsys):
    assert tiny_scene.run("resolve", overrides=(override,)) == 0
    assert "exceed the limit of 0.0004; raise photograph.max_megapixels" in refused(tiny_scene, capsys, "photograph")
    assert tiny_scene.run("resolve", "photograph", overrides=("photograph.max_megapixels=0.0005",)) == 0


@pytest.mark.parametrize("limit", [100.0, 8_000.0])
def test_limit_of_all_renders(limit, tiny_scene, capsys, monkeypatch):
    """The first stops the estimate's renders (24 * 18 * 5 points), the second those of the fog."""
    import pipeline.stages.illumination as illumination

    monkeypatch.setattr(illumination, "render", lambda build, scene, planned, templates: None)
    tiny_scene.replace("samples: 8", f"samples: 8\n  max_light_samples: {limit:.0f}")
    stages = (*BEFORE_RENDERS, "illumination", "plan")
    message = refused(tiny_scene, capsys, *stages)
    assert "POV-Ray would have to light" in message and "or raise render.max_light_samples" in message
    assert ("irradiance_" in message) == (limit == 100)
    tiny_scene.replace(f"max_light_samples: {limit:.0f}", "max_light_samples: 1000000")
    assert tiny_scene.run(*stages) == 0


@pytest.mark.parametrize("read", [photographs.read, lambda path: read_labels(path, 4, 4, ["#ff0000"])])
def test_limit_of_channels(read, tmp_path):
    spec = oiio.ImageSpec(4, 4, 65, oiio.HALF)
    out = oiio.ImageOutput.create(str(tmp_path / "deep.exr"))
    out.open(str(tmp_path / "deep.exr"), spec)
    out.write_image(np.zeros((4, 4, 65), np.float32))
    out.close()
    with pytest.raises(InputError, match="65 channels; save it with 64 at most, which is fixed"):
        read(tmp_path / "deep.exr")


# ---- found by the fuzzer -------------------------------------------------------------------------

def test_messages_neither_command_a_terminal_nor_fill_it(tiny_scene, capsys):
    error = InputError("a \x1b[2J\x07 of " + "x" * 9000, remedy="y\u202ez")
    assert str(error).isprintable() and len(error.problem) <= LONGEST and "[2J" in error.problem
    tiny_scene.replace("type: room", "type: \"\\e[31m" + "x" * 3000 + "\"")
    refused(tiny_scene, capsys, "resolve")


def exr(path: Path, pixels: np.ndarray, **attributes) -> Path:
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], oiio.FLOAT)
    for name, value in attributes.items():
        spec.attribute(name, f"float[{len(value)}]", value)
    out = oiio.ImageOutput.create(str(path))
    assert out.open(str(path), spec) and out.write_image(pixels.astype(np.float32)) and out.close()
    return path


def test_chromaticities_of_no_colour_space(tmp_path):
    path = exr(tmp_path / "x.exr", np.ones((2, 2, 3)), chromaticities=(0.0,) * 8)
    with pytest.raises(InputError, match="x.exr: chromaticities .* are of no colour space.*; remove them, or set colour_space"):
        photographs.read(path)


def test_floats_beyond_light_are_clipped(tmp_path):
    pixels = np.full((1, 3, 3), 0.5)
    pixels[0, 0], pixels[0, 1] = 1e38, 1e20
    for colour_space in ("linear", "srgb"):
        photograph = photographs.read(exr(tmp_path / "x.exr", pixels), colour_space)
        assert photograph.clipped.tolist() == [[True, True, False]]
        assert np.isfinite(photograph.radiance).all() and (photograph.radiance[0, :2] == 0).all()


def test_labels_of_floats_that_are_none(tmp_path):
    pixels = np.zeros((4, 4, 3))
    pixels[..., 0], pixels[0, 0], pixels[1, 1] = 1, np.nan, 1e38
    with np.errstate(all="raise"):
        labels = read_labels(exr(tmp_path / "x.exr", pixels), 4, 4, ["#ff0000", "#0000ff"])
    assert (labels[2:] == 0).all()


def test_damaged_files_whose_errors_are_no_text():
    from pipeline.imaging.oiio_error import oiio_error

    class Source:
        @staticmethod
        def geterror():
            return b"\xb5".decode()

    assert oiio_error(Source) == "its header holds no text where there should be some"


def test_outlines_that_come_out_too_far_away(tiny_scene, capsys):
    tiny_scene.replace(POINTS, "on: room.ceiling\n      offset: -9.0e+8\n      pixels: [[2, 2], [20, 2], [20, 6], [2, 6]]")
    message = refused(tiny_scene, capsys)
    assert "scene.yaml" in message and "lamp" in message


@pytest.mark.parametrize("suffix", ["npy", "df3", "vdb"])
def test_damaged_grids(suffix, tiny_scene, capsys):
    stream = io.BytesIO()
    np.save(stream, np.ones((3, 4, 5), np.float32))
    data = {"npy": stream.getvalue().replace(b"(3, 4, 5)", b"(3, 4, \x80)"), "df3": b"\xff" * 9, "vdb": b" BDV" + bytes(90)}[suffix]
    (tiny_scene.folder / f"density.{suffix}").write_bytes(data)
    assert tiny_scene.run("resolve", "photograph", "camera", "geometry", "sun_direction", overrides=(
        "fog={type: grid, file: density.%s, visibility: 5, lower: [-1, 0, -4], upper: [1, 2, -1]}" % suffix,)) == 0
    assert f"density.{suffix}: cannot be read" in refused(tiny_scene, capsys, "illumination", "plan")


def test_stand_ins_beyond_bounds(tiny_scene, capsys):
    text = tiny_scene.file.read_text()
    text = text.replace("position: [0, 1.2, 0]", "position: [1.0e+7, 1.2, 0]").replace("look_at: [0,", "look_at: [1.0e+7,")
    region = "r: {class: vertical, depth: 100, pixels: [[0, 0], [24, 0], [24, 18], [0, 18]]}"
    start, end = text.index("shapes:"), text.index("lights:")
    tiny_scene.file.write_text(text[:start] + "depth:\n  regions:\n    " + region + "\n" + text[end:])
    assert "what stands in for region r reaches beyond 1e+07 m" in refused(tiny_scene, capsys)


def test_a_scene_of_nothing_but_a_depth_map(tiny_scene):
    """Nothing stands in for a depth that is the same everywhere: the open sky is as far as it goes."""
    (tiny_scene.folder / "depth.png").write_bytes(imagecodecs.png_encode(np.full((18, 24), 65535, np.uint16)))
    text = tiny_scene.file.read_text()
    start, end = text.index("shapes:"), text.index("lights:")
    lights = "lights:\n  sky: {type: sky, radiance: [1, 1, 1]}\nillumination: {type: manual}\n"
    tiny_scene.file.write_text(text[:start] + "depth: {sky_depth: 60, map: {file: depth.png}}\n" + lights + text[text.index("fog:"):])
    assert tiny_scene.run(*BEFORE_RENDERS, "illumination", "plan", "emit") == 0 and end > start
    assert main(["plan", "--scene", "tiny", "--scenes", str(tiny_scene.root / "scenes"),
                 "--build", str(tiny_scene.root / "build")]) == 0
