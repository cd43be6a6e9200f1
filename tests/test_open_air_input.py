"""An open-air scene through the command line up to its geometry, and mistakes in its depth section."""

from __future__ import annotations

import json
from dataclasses import dataclass

import imagecodecs
import numpy as np
import OpenImageIO as oiio
import pytest

from pipeline.imaging.maps import read_map, write_map
from pipeline.scene.artefacts import read_camera, read_edges, read_placed
from tests.conftest import TinyScene
from tests.test_bad_input import refusal

STAGES = ("resolve", "photograph", "camera", "geometry")
WIDTH, HEIGHT, HORIZON = 48, 36, 18
GREEN, BLUE, RED, OWN = (0, 255, 0), (0, 0, 255), (255, 0, 0), (255, 128, 0)

SCENE = """\
photograph:
  file: photograph.png
camera:
  horizontal_field_of_view: 60
  horizon: [[0, 18], [48, 18]]
  height: 1.6
depth:
  sky_depth: 3000
  regions:
    sky: {class: sky, pixels: [[0, 0], [48, 0], [48, 19], [0, 19]]}
    ground: {class: support, pixels: [[0, 19], [48, 19], [48, 36], [0, 36]]}
    wall:
      class: vertical
      foot: [[4, 30], [20, 24]]
      pixels: [[4, 4], [20, 8], [20, 24], [4, 30]]
    post: {class: vertical, pixels: [[30, 6], [33, 6], [33, 28], [30, 28]]}
lights:
  sky: {type: sky, radiance: [0.7, 0.8, 1]}
  ground: {type: ground, radiance: [0.1, 0.1, 0.1]}
illumination: {type: manual}
fog: {type: homogeneous, visibility: 80}
"""
LABELS_ONLY = SCENE[:SCENE.index("  regions:")] + "  labels: labels.png\n" + SCENE[SCENE.index("lights:"):]
MAP_ONLY = LABELS_ONLY.replace("labels: labels.png", "map: {file: depth.exr, kind: radial}")


def painting() -> np.ndarray:
    """As the regions of SCENE, with a second post in a colour of its own."""
    codes = np.full((HEIGHT, WIDTH, 3), BLUE, np.uint8)
    codes[HORIZON + 1:] = GREEN
    codes[6:28, 30:33], codes[4:24, 38:44] = RED, OWN
    return codes


@pytest.fixture
def scene(tmp_path, monkeypatch) -> TinyScene:
    for name in ("FOG_SCENE", "FOG_NAME", "FOG_OVERRIDES", "FOG_SCENES", "FOG_BUILD"):
        monkeypatch.delenv(name, raising=False)
    scene = TinyScene(tmp_path, "yard")
    scene.folder.mkdir(parents=True)
    scene.file.write_text(SCENE)
    paint(scene, painting())
    photograph = np.where((painting() == BLUE).all(-1)[..., None], (200, 210, 230), (70, 60, 50)).astype(np.uint8)
    (scene.folder / "photograph.png").write_bytes(imagecodecs.png_encode(photograph))
    write_map(scene.folder / "depth.exr", np.full((HEIGHT, WIDTH), 25.0, np.float32), is_depth=True)
    return scene


def paint(scene: TinyScene, codes: np.ndarray) -> None:
    (scene.folder / "labels.png").write_bytes(imagecodecs.png_encode(codes))


def ground_depth(scene: TinyScene, row: int, column: int) -> float:
    camera = read_camera(scene.build)
    ray = camera.directions(np.array([column + 0.5, row + 0.5]))
    return -camera.position[1] / ray[1]


def standing_distance(scene: TinyScene, pixel) -> float:
    """Distance [m] along the ground to the spot of it that a pixel shows."""
    camera = read_camera(scene.build)
    ray = camera.directions(np.array(pixel, float))
    return float(np.hypot(ray[0], ray[2]) * camera.position[1] / -ray[1])


def geometry(scene: TinyScene):
    """depth.exr (H, W), surfaces.exr (H, W, 3) and geometry.json, which must fit one another."""
    facts = json.loads(scene.build.geometry.read_text())
    depth, surfaces = read_map(scene.build.depth), read_map(scene.build.surfaces)
    assert depth.shape == (HEIGHT, WIDTH) and np.isfinite(depth).all() and depth.min() > 0
    assert facts["outdoors"] is True and surfaces[..., 0].max() < len(facts["faces"])
    assert sum(one["share"] for one in facts["regions"].values()) == pytest.approx(1)
    assert set(read_placed(scene.build).shapes) == set(facts["shapes"])
    return depth, surfaces, facts


# ---- what comes out --------------------------------------------------------------------------------------------------

def test_regions(scene):
    assert scene.run(*STAGES) == 0
    depth, surfaces, facts = geometry(scene)
    assert (depth[2] == 3000).all() and (surfaces[2] == [-1, -1, 0]).all()
    assert depth[34, 24] == pytest.approx(ground_depth(scene, 34, 24), rel=1e-6)
    assert list(facts["regions"]) == ["sky", "ground", "wall", "post"]
    assert facts["faces"] == [f"region_{name}.surface" for name in ("ground", "wall", "post")]
    for row, column, name in ((34, 24, "ground"), (15, 8, "wall"), (15, 31, "post")):
        assert facts["faces"][int(surfaces[row, column, 0])] == f"region_{name}.surface"
        assert list(facts["regions"])[int(surfaces[row, column, 2])] == name
    assert facts["ground_faces"] == [0] and facts["sky_depth_m"] == 3000
    np.testing.assert_allclose(facts["region_normals"]["ground"], [0, 1, 0], atol=1e-12)
    # its foot is drawn from near to far: the wall's depth follows, at the foot's own columns that of the ground
    assert depth[15, 5] < depth[15, 12] < depth[15, 19]
    # at the camera's height, nearly, a thing is as far as its foot along the ground
    assert depth[17, 31] == pytest.approx(standing_distance(scene, [31.5, 28]), rel=1e-3)
    assert facts["regions"]["post"]["triangles"] == 12 and facts["messages"] == []


def test_labels(scene):
    scene.file.write_text(LABELS_ONLY.replace("  labels: labels.png\n", """\
  labels: labels.png
  regions:
    booth: {class: vertical, label: "#FF8000", depth: 40, porous: true}
    gone: {class: vertical, label: "#123456"}
"""))
    assert scene.run(*STAGES) == 0
    depth, _, facts = geometry(scene)
    assert set(facts["regions"]) == {"sky", "support", "vertical", "booth"}
    assert facts["messages"] == ["region gone: its colour #123456 is nowhere in labels.png"]
    assert depth[10, 41] == pytest.approx(40, rel=0.01)
    assert depth[17, 31] == pytest.approx(standing_distance(scene, [31.5, 28]), rel=1e-3)
    assert (depth[2, :30] == 3000).all() and depth[34, 2] == pytest.approx(ground_depth(scene, 34, 2), rel=1e-6)


def test_regions_lie_over_labels_and_names_do_not_clash(scene):
    codes = painting()
    codes[8:26, 20:24] = RED  # a second patch
    paint(scene, codes)
    outline = "[[30, 20], [33, 20], [33, 24], [30, 24]]"
    scene.replace("  regions:\n", "  labels: labels.png\n  regions:\n"
                                  f"    vertical: {{class: vertical, depth: 5, pixels: {outline}}}\n")
    scene.replace("    post:", "    booth: {class: vertical, label: \"#ff8000\"}\n    post:")
    scene.replace("    sky: {class: sky, pixels: [[0, 0], [48, 0], [48, 19], [0, 19]]}\n", "")
    scene.replace("    ground: {class: support, pixels: [[0, 19], [48, 19], [48, 36], [0, 36]]}\n", "")
    scene.replace(scene.file.read_text()[scene.file.read_text().index("    post:"):
                                         scene.file.read_text().index("lights:")], "")
    assert scene.run(*STAGES) == 0
    depth, _, facts = geometry(scene)
    assert list(facts["regions"]) == ["vertical:1", "vertical:2", "support", "sky", "booth", "vertical", "wall"]
    assert depth[22, 31] == pytest.approx(5, rel=0.02) and depth[15, 31] > 6


@pytest.mark.parametrize("kind", ["planar", "radial", "disparity"])
def test_depth_map(kind, scene):
    baseline = ", baseline: 0.5" if kind == "disparity" else ""
    scene.file.write_text(MAP_ONLY.replace("kind: radial", f"kind: {kind}{baseline}"))
    assert scene.run("resolve", "photograph", "camera") == 0
    camera = read_camera(scene.build)
    radial = np.where(np.arange(HEIGHT)[:, None] < 10, 9000, 6 + np.arange(WIDTH) / 8.0)
    planar = radial * (camera.directions(camera.pixel_centres()) @ camera.world_from_camera[:, 2])
    stored = {"planar": planar, "radial": radial, "disparity": camera.focal_length * 0.5 / planar}[kind]
    write_map(scene.folder / "depth.exr", stored.astype(np.float32), is_depth=True)
    assert scene.run(*STAGES) == 0
    depth, surfaces, facts = geometry(scene)
    np.testing.assert_allclose(depth, np.minimum(radial, 3000), rtol=1e-5)
    assert list(facts["regions"]) == ["map:1", "map:sky"]
    assert (surfaces[:10, :, 0] == -1).all() and (surfaces[10:, :, 0] == 0).all()
    assert facts["regions"]["map:1"]["mesh_error"] < 0.01 and facts["regions"]["map:1"]["triangles"] > 0


def test_regions_complete_a_depth_map(scene):
    known = np.full((HEIGHT, WIDTH), 25.0, np.float32)
    known[:10] = 0
    write_map(scene.folder / "depth.exr", known, is_depth=True)
    scene.file.write_text(MAP_ONLY.replace("  map:", """\
  regions:
    sky: {class: sky, pixels: [[0, 0], [48, 0], [48, 10.5], [0, 10.5]]}
    post: {class: vertical, depth: 7, pixels: [[30, 6], [33, 6], [33, 28], [30, 28]]}
  map:"""))
    assert scene.run(*STAGES) == 0
    depth, _, facts = geometry(scene)
    assert (depth[:6] == 3000).all() and depth[20, 10] == 25 and depth[20, 31] == pytest.approx(7, rel=0.01)
    assert list(facts["regions"]) == ["sky", "post", "map:1"]


def test_edges_are_refined_as_far_as_the_scene_says(scene):
    assert scene.run(*STAGES) == 0
    edges, photograph = read_edges(scene.build), read_map(scene.build.photograph)
    assert edges.mixed.any() and not edges.mixed.all()
    mix = edges.alpha[..., None] * edges.front + (1 - edges.alpha[..., None]) * edges.behind
    np.testing.assert_allclose(mix, photograph, rtol=1e-5)  # of 32 bits, where colours nearly cancel
    assert scene.run(*STAGES, overrides=("depth.refine.radius=0",)) == 0
    assert not read_edges(scene.build).mixed.any()


def test_photographs_with_values_that_are_none(scene):
    radiance = np.where(painting() == 255, 3.0, 0.2).astype(np.float32)
    radiance[5, 31], radiance[20, 10], radiance[0, 0] = np.nan, np.inf, -np.inf
    spec = oiio.ImageSpec(WIDTH, HEIGHT, 3, "float")
    output = oiio.ImageOutput.create(str(scene.folder / "photograph.exr"))
    assert output.open(str(scene.folder / "photograph.exr"), spec) and output.write_image(radiance) and output.close()
    scene.replace("photograph.png", "photograph.exr")
    assert scene.run(*STAGES) == 0
    geometry(scene)
    edges = read_edges(scene.build)
    for values in (edges.alpha, edges.front, edges.behind, edges.front_depth, edges.behind_depth):
        assert np.isfinite(values).all()


def test_shapes_of_the_scene_stand_among_its_regions(scene):
    scene.replace("lights:", """\
shapes:
  kiosk: {type: cuboid, centre: [0, 1, -6], size: [1, 2, 1]}
  hidden: {type: cuboid, centre: [-3.2, 1, -30], size: [1, 2, 1]}
lights:
  shop:
    type: area
    outline: {points: [[0.3, 1, -5.49], [-0.3, 1, -5.49], [-0.3, 1.6, -5.49], [0.3, 1.6, -5.49]]}
    radiance: [3, 3, 3]
  sign:
    type: area
    outline: {on: wall, pixels: [[8, 12], [12, 12], [12, 18], [8, 18]]}
    radiance: [3, 3, 3]
  behind_the_wall:
    type: area
    outline: {points: [[-3.4, 0.6, -29.4], [-3.4, 1.6, -29.4], [-3.0, 1.6, -29.4], [-3.0, 0.6, -29.4]]}
    radiance: [3, 3, 3]
""")
    assert scene.run(*STAGES) == 0
    depth, surfaces, facts = geometry(scene)
    assert facts["faces"][int(surfaces[24, 24, 0])].startswith("kiosk.")
    assert depth[24, 24] == pytest.approx(5.6, rel=0.02)
    lit = surfaces[..., 1]
    names = list(facts["lights"])
    # a lamp that a region hides is not seen
    assert {names[int(i)] for i in np.unique(lit[lit >= 0])} == {"shop", "sign"}
    assert (lit[13:17, 9:11] == names.index("sign")).all()  # though the wall and it coincide
    assert (surfaces[..., 2][lit == names.index("shop")] == -1).all()
    edges = read_edges(scene.build)
    assert (edges.alpha[24, 23:26] == 1).all()  # before the regions, as sharp as they are
    mix = edges.alpha[..., None] * edges.front + (1 - edges.alpha[..., None]) * edges.behind
    np.testing.assert_allclose(mix, read_map(scene.build.photograph), rtol=1e-5)


def test_another_painting_redoes_the_geometry(scene):
    scene.file.write_text(LABELS_ONLY)
    assert scene.run(*STAGES) == 0
    described = scene.build.input("depth")
    before, first = described.stat().st_mtime_ns, read_map(scene.build.depth)
    assert set(json.loads(described.read_text())["sha256"]) == {"labels.png"}
    assert scene.run("resolve") == 0
    assert described.stat().st_mtime_ns == before, "nothing changed, nothing is redone"
    codes = painting()
    codes[4:24, 38:44] = RED
    paint(scene, codes)
    assert scene.run(*STAGES) == 0
    assert described.stat().st_mtime_ns > before
    assert not np.array_equal(read_map(scene.build.depth), first)


def test_another_depth_map_redoes_the_geometry(scene):
    scene.file.write_text(MAP_ONLY)
    assert scene.run(*STAGES) == 0
    before = scene.build.input("depth").stat().st_mtime_ns
    write_map(scene.folder / "depth.exr", np.full((HEIGHT, WIDTH), 30.0, np.float32), is_depth=True)
    assert scene.run(*STAGES) == 0
    assert scene.build.input("depth").stat().st_mtime_ns > before and read_map(scene.build.depth)[5, 5] == 30


def test_a_scene_that_leaves_the_open_air_leaves_no_edges(scene):
    assert scene.run(*STAGES) == 0 and scene.build.edges.exists()
    text = scene.file.read_text()
    room = "shapes:\n  room: {type: room, lower: [-3, 0, -9], upper: [3, 3, 3]}\n"
    scene.file.write_text(text[:text.index("depth:")] + room + text[text.index("lights:"):])
    assert scene.run(*STAGES) == 0
    assert not scene.build.edges.exists() and read_edges(scene.build) is None


# ---- what a person can do wrong --------------------------------------------------------------------------------------

@dataclass
class Edit:
    """An edit of the scene file, the words at whose line the mistake is (None: a file's own), and what is said."""

    id: str
    old: str
    new: str
    at: str | None
    says: tuple[str, ...]


POST = "    post: {class: vertical, pixels: [[30, 6], [33, 6], [33, 28], [30, 28]]}\n"
DEPTH = SCENE[SCENE.index("depth:"):SCENE.index("lights:")]
REGIONS = "  regions:\n"


def post(more: str) -> str:
    return POST.replace("vertical,", f"vertical, {more},")


def section(text: str) -> str:
    return "depth:\n" + text


EDITS = [
    Edit("nothing at all", DEPTH, "depth: {}\n", "depth:",
         ("depth: nothing says how far anything is", "'labels' or a 'map'")),
    Edit("unknown key", "  sky_depth: 3000", "  sky_dept: 3000", "sky_dept:",
         ("depth.sky_dept", "did you mean 'sky_depth'")),
    Edit("sky depth of 0", "sky_depth: 3000", "sky_depth: 0", "sky_depth", ("depth.sky_depth = 0", "1e-06 or more", "[m]")),
    Edit("sky depth without bound", "sky_depth: 3000", "sky_depth: .inf", "sky_depth", ("depth.sky_depth = inf",)),
    Edit("class missing", "class: vertical, pixels: [[30", "pixels: [[30", "post:",
         ("depth.regions.post: 'class' is missing",)),
    Edit("unknown class", "{class: vertical", "{class: tree", "post:",
         ("depth.regions.post.class = 'tree'", "'support', 'vertical' or 'sky'")),
    Edit("unknown key of a region", POST, post("dept: 4"), "post:",
         ("depth.regions.post.dept", "did you mean 'depth'")),
    Edit("a name with a space", "    post:", "    the post:", "the post",
         ("depth.regions.the post", "beginning with a letter")),
    Edit("outline of two points", "[[30, 6], [33, 6], [33, 28], [30, 28]]", "[[30, 6], [33, 6]]", "post:",
         ("depth.regions.post.pixels", "at least 3 entries, not 2")),
    Edit("outline with a word", "[33, 28], [30, 28]]", "[33, 28], [30, low]]", "post:",
         ("pixels.3.1 = 'low'", "[pixel]")),
    Edit("outline that is not finite", "[33, 28], [30, 28]]", "[33, 28], [30, .nan]]", "post:", ("pixels.3.1 = nan",)),
    Edit("no outline", POST, "    post: {class: vertical, depth: 4}\n", "post:",
         ("depth.regions.post: no outline", "'label'")),
    Edit("outline and label", POST, post("label: '#ff8000'"), "post:", ("both 'pixels' and 'label'",)),
    Edit("colour without picture", POST, "    post: {class: vertical, label: '#ff8000'}\n", "post:",
         ("'#ff8000' is a colour of no picture", "give 'labels'")),
    Edit("colour by name", REGIONS + "    sky:",
         "  labels: labels.png\n" + REGIONS + "    a: {class: sky, label: orange}\n    sky:",
         "a: {", ("depth.regions.a.label = 'orange'",)),
    Edit("one colour twice", REGIONS + "    sky:", "  labels: labels.png\n" + REGIONS
         + "    a: {class: sky, label: '#FF8000'}\n    b: {class: vertical, label: '#ff8000'}\n    sky:", "b: {",
         ("'#ff8000' is the colour of a, too", "a colour of its own")),
    Edit("holes in a painted region", REGIONS + "    sky:", "  labels: labels.png\n" + REGIONS
         + "    a: {class: vertical, label: '#ff8000', holes: [[[1, 1], [2, 2], [1, 2]]]}\n    sky:", "a: {",
         ("'holes' are cut out of 'pixels'", "unpainted")),
    Edit("foot and depth", POST, post("foot: [[30, 28], [33, 28]], depth: 9"), "post:",
         ("both 'foot' and 'depth'", "keep one")),
    Edit("foot of one point", POST, post("foot: [[30, 28]]"), "post:", ("post.foot", "at least 2 entries, not 1")),
    Edit("foot above the horizon", POST, post("foot: [[30, 28], [33, 12]]"), "post:",
         ("post: its foot [33, 12] lies above the horizon", "'depth' [m]")),
    Edit("foot of one spot", POST, post("foot: [[30, 28], [30, 28]]"), "post:",
         ("post: two points of its foot are one",)),
    Edit("thing in the air", "[[30, 6], [33, 6], [33, 28], [30, 28]]", "[[30, 6], [33, 6], [33, 9], [30, 9]]", "post:",
         ("post: nowhere reaches below the horizon", "[31.5, 9]", "give its 'depth' [m]")),
    Edit("depth below 0", POST, post("depth: -4"), "post:", ("depth.regions.post.depth = -4", "1e-06 or more", "[m]")),
    Edit("thickness below 0", POST, post("thickness: -4"), "post:", ("post.thickness = -4", "0 or more")),
    Edit("porous in words", POST, post("porous: very"), "post:", ("post.porous = 'very'", "true or false")),
    Edit("sky with a foot", "{class: sky,", "{class: sky, foot: [[3, 30], [9, 30]],", "sky: {",
         ("'foot' has no meaning for a region of class sky", "leave it out")),
    Edit("ground with a depth", "{class: support,", "{class: support, depth: 4,", "ground:",
         ("'depth' has no meaning for a region of class support",)),
    Edit("porous ground", "{class: support,", "{class: support, porous: true,", "ground:",
         ("'porous' has no meaning for a region of class support",)),
    Edit("wall with near", POST, post("near: 4, far: 9"), "post:",
         ("'near' has no meaning for a region of class vertical",)),
    Edit("near without far", "{class: support,", "{class: support, near: 4,", "ground:",
         ("'near' and 'far' go together",)),
    Edit("near beyond far", "{class: support,", "{class: support, near: 9, far: 4,", "ground:",
         ("near 9.0 is not below far 4.0", "[m]")),
    Edit("photograph not covered", "[48, 36], [0, 36]]}", "[48, 30], [0, 30]]}", "depth:",
         ("no region covers", "for example pixel [", "draw regions over all of it, or give a depth 'map'")),
    Edit("all regions outside", DEPTH,
         section("  regions:\n    far: {class: sky, pixels: [[60, 0], [70, 0], [70, 9]]}\n"), "depth:",
         ("no region covers 100.0% of the photograph",)),
    Edit("label image outside by ..", DEPTH, section("  labels: ../labels.png\n"), "depth:",
         ("'../labels.png' leads out of the scene's folder",)),
    Edit("label image by an absolute name", DEPTH, section("  labels: /etc/passwd\n"), "depth:",
         ("'/etc/passwd' leads out of the scene's folder",)),
    Edit("label image missing", DEPTH, section("  labels: lables.png\n"), None,
         ("lables.png: no such file", "scene.yaml:7")),
    Edit("label image is text", DEPTH, section("  labels: scene.yaml\n"), None,
         ("scene.yaml: cannot be read as a picture", "give a PNG, TIFF or EXR file")),
    Edit("label image is a folder", DEPTH, section("  labels: .\n"), None, ("cannot be read", "directory")),
    Edit("depth map outside", DEPTH, section("  map: {file: ../depth.exr}\n"), "depth:", ("'../depth.exr' leads out",)),
    Edit("depth map missing", DEPTH, section("  map: {file: deep.exr}\n"), None,
         ("deep.exr: no such file", "scene.yaml:7")),
    Edit("depth map without file", DEPTH, section("  map: {kind: radial}\n"), "map:",
         ("depth.map: 'file' is missing",)),
    Edit("depth map of an unknown kind", DEPTH, section("  map: {file: depth.exr, kind: stereo}\n"), "map:",
         ("depth.map.kind = 'stereo'", "'planar', 'radial' or 'disparity'")),
    Edit("disparity without baseline", DEPTH, section("  map: {file: depth.exr, kind: disparity}\n"), "map:",
         ("'baseline' goes with kind disparity", "add 'baseline' [m]")),
    Edit("baseline without disparity", DEPTH, section("  map: {file: depth.exr, baseline: 0.1}\n"), "map:",
         ("'baseline' goes with kind disparity", "leave out 'baseline'")),
    Edit("disparity in metres", DEPTH,
         section("  map: {file: depth.exr, kind: disparity, baseline: 1, metres_per_unit: 2}\n"), "map:",
         ("disparity is in pixels", "leave out 'metres_per_unit'")),
    Edit("focal length of 0", DEPTH, section("  map: {file: depth.exr, focal_length: 0}\n"), "map:",
         ("depth.map.focal_length = 0", "[pixel]")),
    Edit("depth map in colours", DEPTH, section("  map: {file: photograph.png}\n"), None,
         ("photograph.png: has the channels R, G, B, which differ",)),
    Edit("radius below 0", "  sky_depth: 3000", "  sky_depth: 3000\n  refine: {radius: -1}", "radius",
         ("depth.refine.radius = -1", "0 or more", "[pixel]")),
    Edit("radius by half", "  sky_depth: 3000", "  sky_depth: 3000\n  refine: {radius: 2.5}", "radius",
         ("depth.refine.radius = 2.5", "a whole number")),
    Edit("shape that is called like a stand-in", "lights:\n", "shapes:\n  region_post: {type: room, lower: [-9, 0, -9],"
         " upper: [9, 9, 9]}\nlights:\n", "shapes:", ("a shape is called 'region_post', which stands in", "rename")),
    Edit("lamp on a region that is none", "lights:\n", "lights:\n  lamp: {type: point, intensity: [1, 1, 1],"
         " position: {pixel: [9, 9], on: wal}}\n", "lamp:", ("lamp", "'wal'", "did you mean 'wall'")),
]


@pytest.mark.parametrize("edit", EDITS, ids=lambda edit: edit.id)
def test_mistakes(edit, scene, capsys):
    scene.replace(edit.old, edit.new)
    message = refusal(scene.run(*STAGES), capsys.readouterr().err, scene.root)
    if edit.at is not None:
        assert message.startswith(f"{scene.file}:{scene.line(edit.at)}: "), message
    for words in edit.says:
        assert words in message, message
    assert not scene.build.geometry.exists() and not scene.build.depth.exists()


@pytest.mark.parametrize("codes, says", [
    (painting()[:, :30], "labels.png: 30x36 pixels have another shape than the photograph's 48x36; paint over"),
    (np.full((HEIGHT, WIDTH, 3), 255, np.uint8), "no region covers 100.0% of the photograph"),
    (np.where(np.arange(WIDTH)[:, None] < 24, painting(), 0).astype(np.uint8), "no region covers 4"),
    (np.repeat(painting()[:, :, :1] // 2 + 64, 3, -1), "no region covers"),
], ids=["another shape", "white", "half black", "grey"])
def test_paintings_that_are_none(codes, says, scene, capsys):
    scene.file.write_text(LABELS_ONLY)
    paint(scene, np.ascontiguousarray(codes))
    message = refusal(scene.run(*STAGES), capsys.readouterr().err, scene.root)
    assert says in message and not scene.build.geometry.exists()


def test_a_painted_patch_in_the_air_with_nothing_beside_it(scene, capsys):
    codes = painting()
    codes[6:28, 30:33], codes[4:24, 38:44], codes[3:9, 5:11] = BLUE, BLUE, RED
    codes[HORIZON + 1:] = GREEN
    paint(scene, codes)
    scene.file.write_text(LABELS_ONLY)
    message = refusal(scene.run(*STAGES), capsys.readouterr().err, scene.root)
    assert message.startswith(f"{scene.file}:{scene.line('labels:')}: vertical: the patch painted at [5, 3] lies above")


@pytest.mark.parametrize("file", ["labels.png", "depth.exr"])
def test_damaged_files(file, scene, capsys):
    scene.file.write_text(LABELS_ONLY if file == "labels.png" else MAP_ONLY)
    path = scene.folder / file
    path.write_bytes(path.read_bytes()[:-40])
    message = refusal(scene.run(*STAGES), capsys.readouterr().err, scene.root)
    assert message.startswith(f"{path}: is damaged") and "write it anew" in message


def test_a_mistake_leaves_the_geometry_before_it_as_it_was(scene, capsys):
    assert scene.run(*STAGES) == 0
    before = {path: path.read_bytes() for path in (scene.build.geometry, scene.build.depth, scene.build.edges)}
    scene.replace("class: vertical, pixels: [[30", "class: vertical, foot: [[30, 28], [33, 12]], pixels: [[30")
    capsys.readouterr()
    refusal(scene.run(*STAGES), capsys.readouterr().err, scene.root)
    assert {path: path.read_bytes() for path in before} == before
