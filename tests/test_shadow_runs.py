"""What shadows take from a glow: one render in two colours where fog is grey, else two renders."""

import shutil

import numpy as np
import pytest

from pipeline import paths
from pipeline.imaging.maps import read_map
from pipeline.rendering.runs import SHADED, SHADOWS, UNSHADED
from pipeline.scene.artefacts import read_json
from pipeline.stages import plan
from tests.test_light_transport import DESCRIBED, chain

HEIGHT = {"type": "height", "absorption_coefficient": [0.05] * 3, "scattering_coefficient": [0.2] * 3,
          "scale_height": 1.0, "phase_function": {"type": "henyey_greenstein", "asymmetry": 0.4}}


def planned(build) -> set[str]:
    return {run["id"] for run in read_json(build.plan)["runs"]}


@pytest.mark.parametrize("fog", [None, HEIGHT], ids=["homogeneous", "height"])
def test_one_render_in_two_colours_is_both(tmp_path, monkeypatch, fog):
    more = {"render": {"quality": "draft"}, **({"fog": fog} if fog else {})}
    one = chain(tmp_path / "one", {"area": DESCRIBED["area"]}, box=True, **more)
    monkeypatch.setattr(plan, "surfaces_are_ours", lambda templates, scene: False)
    two = chain(tmp_path / "two", {"area": DESCRIBED["area"]}, box=True, **more)
    assert f"{SHADOWS}_area" in planned(one) and {f"{SHADED}_area", f"{UNSHADED}_area"} <= planned(two)
    both = read_map(one.runs / f"{SHADOWS}_area.exr")
    for channel, kind in enumerate((SHADED, UNSHADED)):
        # a step of half floats
        np.testing.assert_allclose(both[..., channel], read_map(two.runs / f"{kind}_area.exr")[..., channel], rtol=1e-3)
    assert (both[..., 0] < 0.9 * both[..., 1]).mean() > 0.02, "shadows are there"
    np.testing.assert_allclose(read_map(one.in_scattering()), read_map(two.in_scattering()), rtol=1e-3)


def test_coloured_fog_takes_two(tmp_path):
    fog = {"type": "homogeneous", "absorption_coefficient": [0.0, 0.05, 0.1], "scattering_coefficient": [0.2] * 3,
           "phase_function": {"type": "isotropic"}}
    build = chain(tmp_path, {"area": DESCRIBED["area"]}, box=True, fog=fog)
    assert f"{SHADOWS}_area" not in planned(build) and {f"{SHADED}_area", f"{UNSHADED}_area"} <= planned(build)


@pytest.mark.parametrize("name", ["shapes/cuboid.inc", "fog_surfaces.inc"])
def test_surfaces_of_the_scenes_own_take_two(tmp_path, name):
    build = chain(tmp_path, {"area": DESCRIBED["area"]}, box=True)
    assert f"{SHADOWS}_area" in planned(build)
    own = build.source / name
    own.parent.mkdir(exist_ok=True)
    own.write_text("// a person's own\n")
    plan.run(build)
    assert f"{SHADOWS}_area" not in planned(build)


def test_looks_of_a_persons_own_take_two(tmp_path, monkeypatch):
    build = chain(tmp_path, {"area": DESCRIBED["area"]}, box=True)
    shutil.copytree(paths.TEMPLATES, tmp_path / "templates")
    edited = tmp_path / "templates" / "shapes" / "cuboid.inc"
    edited.write_text(edited.read_text() + "box { 0, 1 pigment { rgb 0 } }\n")
    monkeypatch.setattr(paths, "TEMPLATES", tmp_path / "templates")
    plan.run(build)
    assert f"{SHADED}_area" in planned(build)
