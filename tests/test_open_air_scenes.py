"""The open-air scenes made from real photographs: their annotations alone, over a grey picture of the same size."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from pipeline.cli import main
from pipeline.imaging.maps import read_map, write_map
from pipeline.paths import Build
from pipeline.scene.artefacts import read_json

SCENES = Path(__file__).resolve().parent.parent / "scenes"
#: Width, height, and where the scene says that something stands: pixel, distance [m], and how exactly.
PLACES = {"pagoda": (640, 427, [((210, 200), 60, 0.05), ((320, 20), 6000, 0.01)]),
          "street": (768, 512, [((300, 480), 3.83, 0.05), ((560, 20), 5000, 0.01), ((600, 480), 4.16, 0.05)]),
          "bridge": (1302, 953, [((480, 400), 90, 0.2), ((900, 100), 2000, 0.01), ((700, 900), 21, 0.2)])}


@pytest.fixture(scope="module", params=PLACES)
def placed(request, tmp_path_factory):
    width, height, places = PLACES[request.param]
    folder = tmp_path_factory.mktemp(request.param)
    build = Build(request.param, None, folder / "scenes", folder / "build")
    build.source.mkdir(parents=True)
    shutil.copy(SCENES / request.param / "scene.yaml", build.scene_file)
    write_map(build.source / "grey.exr", np.full((height, width, 3), 0.2, np.float32))
    for stage in ("resolve", "photograph", "camera", "geometry"):
        stated = ["--set=photograph.file=grey.exr"] if stage == "resolve" else []
        assert main([stage, "--scene", build.scene, "--scenes", str(build.scenes), "--build", str(build.builds), *stated]) == 0
    return build, places


def test_distances(placed):
    build, places = placed
    depth = read_map(build.depth).squeeze()
    for (u, v), distance, share in places:
        assert depth[v, u] == pytest.approx(distance, rel=share), (u, v)


def test_every_region_is_seen_and_nothing_is_strange(placed):
    geometry = read_json(placed[0].geometry)
    assert all(region["share"] > 0 for region in geometry["regions"].values()), geometry["regions"]
    assert not geometry["messages"]


def test_the_ground_goes_on_into_the_sky_without_a_gap(placed):
    """Down each column distances of ground fall: the horizon, drawn by hand, is where the ground's depth says."""
    build, _ = placed
    depth, region = read_map(build.depth).squeeze(), read_map(build.surfaces)[..., 2].astype(int)
    kinds = [facts["class"] for facts in read_json(build.geometry)["regions"].values()]
    ground = np.array([kind == "support" for kind in kinds] + [False])[region]
    below = ground[1:] & ground[:-1] & (region[1:] == region[:-1])
    assert below.any() and (np.diff(depth, axis=0)[below] <= 0).all()
