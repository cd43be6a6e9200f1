"""Plugins of a package outside the pipeline, known by entry points alone, through the command line."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from pipeline.imaging.maps import read_map
from pipeline.plugins.registry import registry
from pipeline.scene.artefacts import read_camera

PROJECT = Path(__file__).resolve().parent.parent
OUTSIDE = Path(__file__).resolve().parent / "outside_plugins"
EXTINCTION = 0.4  # [1/m]

COLUMN = """\
  column:
    type: cylinder
    base: [-0.3, 0, -3]
    radius: 0.5
    height: 0.5
"""


def pipeline(*arguments: str, packages: Path = OUTSIDE) -> subprocess.CompletedProcess:
    environment = {name: value for name, value in os.environ.items() if not name.startswith("FOG_")}
    return subprocess.run([sys.executable, "-m", "pipeline", *arguments], cwd=PROJECT, capture_output=True,
                          text=True,
                          timeout=120, env={**environment, "PYTHONPATH": str(packages)})


def test_they_are_not_of_this_package():
    assert "cylinder" not in registry("shapes") and "murk" not in registry("media")


def test_listed_with_parameters_and_units():
    done = pipeline("plugins")
    assert done.returncode == 0, done.stderr
    assert "  cylinder: An upright cylinder." in done.stdout
    assert "    radius [m] required > 0" in done.stdout
    assert "  murk: Even, grey fog" in done.stdout
    assert "    extinction [1/m] required >= 0 <= 1000000.0: light lost a metre" in done.stdout
    assert "    albedo [1] default 0.9" in done.stdout
    assert "  grey: The photograph's mean, everywhere." in done.stdout


def test_in_the_json_schema(tmp_path):
    done = pipeline("schema", "--output", str(tmp_path / "schema.json"))
    assert done.returncode == 0, done.stderr
    schema = json.loads((tmp_path / "schema.json").read_text())
    assert schema["$defs"]["Cylinder"]["properties"]["radius"]["unit"] == "m"
    assert "extinction" in schema["$defs"]["Murk"]["properties"]
    assert "#/$defs/Murk" in json.dumps(schema["properties"]["fog"])
    assert "#/$defs/Cylinder" in json.dumps(schema["properties"]["shapes"])


def test_rendered(tiny_scene):
    """What POV-Ray sees of the curved column and the murk is what Python says of them."""
    tiny_scene.replace("lights:\n", COLUMN + "lights:\n")
    text = tiny_scene.file.read_text()
    lamp = text[text.index("  lamp:"):text.index("  bulb:")]
    tiny_scene.replace(lamp, "")
    tiny_scene.replace("point: [1.2, 1.4, -4]", "point: [0.6, 1.8, -1]")
    fog = text[text.index("fog:"):text.index("render:")]
    tiny_scene.replace(fog, f"fog:\n  type: murk\n  extinction: {EXTINCTION}\n  albedo: 0.5\n")
    done = pipeline("run", "--scene", "tiny", "--scenes", str(tiny_scene.root / "scenes"),
                    "--build", str(tiny_scene.root / "build"))
    assert done.returncode == 0, done.stderr

    build = tiny_scene.build
    depth, transmittance, camera = read_map(build.depth), read_map(build.transmittance), read_camera(build)
    points = camera.position + depth[..., None] * camera.directions(camera.pixel_centres())
    faces = json.loads(build.geometry.read_text())["faces"]
    seen = read_map(build.surfaces)[..., 0].astype(int)
    lit = read_map(build.basis / "irradiance_bulb.exr")[..., 1] > 0
    side, top = seen == faces.index("column.side_0"), seen == faces.index("column.top")
    assert (side & lit).sum() > 10 and (top & lit).sum() > 3
    # the points lie on the cylinder itself: a facet would be up to 38 mm off
    radii = np.hypot(points[side][:, 0] + 0.3, points[side][:, 2] + 3)
    np.testing.assert_allclose(radii, 0.5, atol=1e-5)  # depth.exr is float32
    expected = np.exp(-EXTINCTION * (depth + np.linalg.norm(points - [0.6, 1.8, -1], axis=-1)))
    # POV-Ray writes half floats, 0.05 % each of two renders; a facet's depth would be wrong by 1.5 % and more
    np.testing.assert_allclose(transmittance[..., 1][lit], expected[lit], rtol=0.01)
    assert np.median(np.abs(transmittance[..., 1][side & lit] / expected[side & lit] - 1)) < 0.002
    volume = read_map(build.in_scattering())
    assert np.isfinite(volume).all() and (volume > 0).all()


@pytest.mark.parametrize("entry_points, says", [
    ("[fog.shapes]\nghost = nowhere:Ghost\n",
     ("fog.shapes:ghost of spoilt", "cannot be loaded", "No module named 'nowhere'")),
    ("[fog.media]\nmurk = spoilt:Murk\n",
     ("fog.media:murk of spoilt", "ZeroDivisionError: division by zero")),
    ("[fog.media]\nmurk = json:JSONDecoder\n",
     ("fog.media:murk of spoilt", "is not a Medium of type 'murk'")),
    ("[fog.media]\nhaze = pipeline.plugins.media.homogeneous:Homogeneous\n",
     ("is not a Medium of type 'haze'", "plugin's type")),
], ids=["module missing", "module fails", "no plugin", "name is not its type"])
def test_broken_entry_point_is_named(entry_points, says, tmp_path):
    (tmp_path / "spoilt.py").write_text("1 / 0\n")
    information = tmp_path / "spoilt-0.1.dist-info"
    information.mkdir()
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: spoilt\nVersion: 0.1\n")
    (information / "entry_points.txt").write_text(entry_points)
    done = pipeline("plugins", packages=tmp_path)
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1 and done.stderr.startswith("error: entry point ")
    for words in says:
        assert words in done.stderr
