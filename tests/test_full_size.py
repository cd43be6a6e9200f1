"""Photographs larger than their working size: against the same scenes worked out at full size, in bounded memory."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import cv2
import imagecodecs
import numpy as np
import pytest

from pipeline.cli import main
from pipeline.geometry.enlarged_view import EnlargedView
from pipeline.geometry.visibility import visible
from pipeline.imaging import map_strips
from pipeline.imaging.maps import read_map
from pipeline.paths import Build
from pipeline.physics.enlarging import Enlarging, Pixels, Small, layer_values
from pipeline.scene.artefacts import image_camera, read_json, read_placed, working
from tests.conftest import CHAIN
from tests.enlarged_scene import enlarged_scene, relative_error, round_edges

GEOMETRY = ("resolve", "photograph", "camera", "geometry")


def run(folder: Path, name: str, stages=CHAIN, *overrides: str) -> Build:
    build = Build(name, None, folder, folder / "build")
    for stage in stages:
        options = [word for one in overrides for word in ("--set", one)] if stage == "resolve" else []
        assert main([stage, "--scene", name, "--scenes", str(folder), "--build", str(build.builds), *options]) == 0
    return build


def compare(ours: Build, theirs: Build) -> None:
    where = round_edges(read_map(theirs.depth))
    assert where.mean() > 0.02, "a test of edges needs some"
    for name in ("foggy.exr", "transmittance.exr", "in_scattering.exr"):
        error = relative_error(read_map(ours.out / name), read_map(theirs.out / name))[where]
        # what is enlarged is smooth within a surface, and edges stand where they do at full size
        assert np.median(error) <= 0.02 and np.percentile(error, 99) <= 0.1, name


@pytest.fixture(scope="module")
def street(tmp_path_factory):
    """The painted street, three times as large as its working size, and the same worked out at its own size."""
    folder = tmp_path_factory.mktemp("street")
    builds = []
    for name, size in (("reduced", 200), ("whole", None)):
        enlarged_scene("building", 600, folder / name, working_size=size)
        builds.append(run(folder, name))
    return builds


def test_street_against_full_size(street):
    compare(*street)


def test_annotations_stay_in_the_photographs_pixels(street):
    reduced, whole = (read_json(build.illumination)["lights"] for build in street)
    for light in reduced:
        # patches a third as wide, averages of the same light
        assert np.allclose(reduced[light]["strength"], whole[light]["strength"], rtol=0.03), light
    assert (read_json(street[0].camera)["width_pixel"], read_placed(working(street[0])).camera.width) == (480, 160)


def test_names_and_sizes(street):
    reduced, whole = street
    names, others = ({path.name for path in build.out.glob("*") if path.is_file()} for build in street)
    assert names - others == set() and others - names == {"albedo.exr"}, "what only estimates use stays small"
    for name in names:
        if name.endswith(".exr"):
            assert read_map(reduced.out / name).shape == read_map(whole.out / name).shape, name
    assert max(read_map(working(reduced).transmittance).shape) == 200
    assert not (whole.out / "working").exists()


def test_depth_of_regions_is_that_of_full_size(street):
    assert np.allclose(*(read_map(build.depth) for build in street), rtol=1e-5)
    labels = [read_map(build.surfaces)[..., 2] for build in street]
    assert (labels[0] == labels[1]).all()


def test_strips_join(street, monkeypatch):
    build = street[0]
    before = {name: read_map(build.out / name) for name in ("foggy.exr", "transmittance.exr", "in_scattering_sun.exr")}
    monkeypatch.setattr(map_strips, "STRIP", 480 * 48)
    run(build.scenes, build.scene, ("composite",))
    for name, values in before.items():
        # half floats: one step of them
        assert np.allclose(read_map(build.out / name), values, rtol=1e-3, atol=1e-6), name


def test_report_and_another_working_size(street):
    build = street[0]
    run(build.scenes, build.scene, ("report",))
    assert "480 × 600" in build.report.read_text(encoding="utf-8")
    run(build.scenes, build.scene, ("resolve", "photograph"), "photograph.working_size=null")
    assert not (build.out / "working").exists() and working(build) == build


def test_room_by_its_faces(tmp_path):
    """Depth, faces and lamps of an annotated room: exact, though rays are cast along edges alone."""
    enlarged_scene("bathroom", 1024, tmp_path / "room", working_size=256)
    build = run(tmp_path, "room", GEOMETRY)
    scene = read_placed(build)
    depth, face, emitter = visible(scene.camera, scene.shapes, scene.lights)
    assert np.allclose(read_map(build.depth), depth, rtol=1e-5)
    surfaces = read_map(build.surfaces)
    assert (surfaces[..., 0] != face).sum() + (surfaces[..., 1] != emitter).sum() == 0
    small = image_camera(working(build))
    view = EnlargedView(scene.camera, small, *visible(small, scene.shapes, scene.lights), scene.shapes, scene.lights)
    assert view.plain.mean() > 0.7, "most of the room needs no rays"


def room(tiny, width: int, working_size) -> Build:
    height = width * 3 // 4
    x, y = np.meshgrid(np.linspace(0, 1, width), np.linspace(0, 1, height))
    values = np.stack([0.3 + 0.4 * x, 0.5 - 0.2 * y, 0.4 + 0.1 * x * y], -1)
    path = tiny.build.source / "photograph.png"
    path.write_bytes(imagecodecs.png_encode(np.round(255 * values).astype(np.uint8)))
    size = "null" if working_size is None else working_size
    assert tiny.run(overrides=(f"photograph.working_size={size}",)) == 0
    return tiny.build


def test_room_against_full_size(tiny_scene):
    maps = []
    for size in (96, None):
        build = room(tiny_scene, 288, size)
        maps.append({name: read_map(build.out / name) for name in ("foggy.exr", "transmittance.exr", "in_scattering.exr")})
        depth = read_map(build.depth)
    inverse = 1 / depth
    creases = cv2.dilate((np.abs(cv2.Laplacian(inverse, -1)) > 1e-4).astype(np.uint8), np.ones((25, 25))) > 0
    assert creases.mean() > 0.1
    for name in maps[0]:
        error = relative_error(maps[0][name], maps[1][name])[creases]
        assert np.median(error) <= 0.02 and np.percentile(error, 99) <= 0.1, name


def test_without_fog_the_photograph_comes_back(tiny_scene):
    build = room(tiny_scene, 192, 64)
    assert tiny_scene.run(overrides=("photograph.working_size=64", "fog.visibility=.inf")) == 0
    assert build.foggy(".png").read_bytes() == (build.source / "photograph.png").read_bytes()
    assert (read_map(build.transmittance) == 1).all() and not read_map(build.in_scattering()).any()


def test_a_closed_form_through_two_depths():
    """Airlight before a near and a far wall, from one pixel in eight: exact along both, sharp between."""
    extinction = np.array([0.3, 0.2, 0.1])
    depth = np.where(np.arange(24) < 12, 2.0, 9.0)[None].repeat(16, 0)
    full = np.where(np.arange(192) < 93, 2.0, 9.0)[None].repeat(128, 0).astype(np.float32)

    def light(of):
        return 1 - np.exp(-of[..., None] * extinction)

    values = layer_values(extinction, depth, np.ones(depth.shape), np.exp(-depth[..., None] * extinction), [light(depth)])
    small = Small(depth.astype(np.float32), (depth > 5).astype(np.int32), values)
    pixels = Pixels(full, (full > 5).astype(np.int32), np.zeros(full.shape, bool))
    found = Enlarging(small, full.shape, extinction).rows(0, 128, pixels)
    assert np.allclose(found[1], light(full), rtol=1e-4)
    assert np.allclose(found[0], np.exp(-full[..., None] * extinction), rtol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("longer_side", [5477, 7906])  # 24 and 50 megapixels
def test_memory_is_bounded(longer_side, tmp_path):
    enlarged_scene("building", longer_side, tmp_path / "large")
    for stage in (*CHAIN, "report"):
        child = subprocess.Popen([sys.executable, "-m", "pipeline", stage, "--scene", "large", "--scenes", str(tmp_path),
                                  "--build", str(tmp_path / "build")], stderr=subprocess.DEVNULL)
        _, status, used = os.wait4(child.pid, 0)
        assert status == 0, stage
        # kilobytes
        assert used.ru_maxrss < 3e6 * (1 if longer_side < 6000 else 2), stage
