"""The scene in other programs' languages, and T and V against Mitsuba where it is installed."""

import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from pipeline.cli import main
from pipeline.imaging.maps import read_map
from pipeline.plugins.base import registry
from pipeline.rendering.describe import describe
from pipeline.scene.artefacts import read_fog, read_placed, read_strengths
from tests.test_light_transport import DESCRIBED, chain

MITSUBA = registry("exporters")["mitsuba"]


def arguments(build, command, *more):
    return [command, "--scene", build.scene, "--scenes", str(build.scenes), "--build", str(build.builds), *more]


def test_an_export_is_complete_and_names_what_it_leaves_out(tmp_path):
    build = chain(tmp_path, {kind: DESCRIBED[kind] for kind in ("point", "spot", "sun")})
    assert main(arguments(build, "export", "--to", "mitsuba")) == 0
    folder = build.export("mitsuba")
    assert {f"{what}_{light}.xml" for what in ("in_scattering", "transmittance", "clear") for light in ("point", "sun")} < {
        path.name for path in folder.glob("*.xml")}
    for path in folder.glob("*.xml"):
        root = ElementTree.fromstring(path.read_text())
        identities = {node.get("id") for node in root.iter() if node.get("id")}
        assert {node.get("id") for node in root.iter("ref")} <= identities, path
        assert all((folder / node.get("value")).is_file() for node in root.iter("string") if node.get("name") == "filename")
    assert "light 'spot' (spot)" in (folder / "foggy.xml").read_text()


def test_an_unknown_language_is_refused(tmp_path, capsys):
    build = chain(tmp_path, {"point": DESCRIBED["point"]})
    capsys.readouterr()
    assert main(arguments(build, "export", "--to", "blender")) == 2
    error = capsys.readouterr().err
    assert "no exporter is called 'blender'" in error and "mitsuba, " in error and len(error.splitlines()) <= 2


@pytest.mark.parametrize("kind", ["point", "area"])
def test_depth_and_in_scattering_are_mitsubas(tmp_path, kind):
    """A few coarse pixels: the median of the ratio averages over the noise of single ones."""
    mitsuba = pytest.importorskip("mitsuba")
    mitsuba.set_variant("scalar_rgb")
    build = chain(tmp_path, {kind: DESCRIBED[kind]}, box=True)
    exporter = MITSUBA(samples=128)
    description = describe("in_scattering", read_placed(build), read_fog(build), read_strengths(build), [kind], {}, exporter)
    for file, content in exporter.export("one", description).items():
        (tmp_path / file).write_bytes(content if isinstance(content, bytes) else content.encode())
    scene = mitsuba.load_file(str(tmp_path / "one.xml"))
    theirs, ours = np.array(mitsuba.render(scene, seed=1)), read_map(build.in_scattering())
    # a standard error of about 0.5 % over all pixels; the sum is not swayed by their spread
    away = (theirs.max(-1) < np.percentile(theirs.max(-1), 95)) & (read_map(build.surfaces)[..., 1] < 0)
    assert abs(ours[away].sum() / theirs[away].sum() - 1) < 0.03
    depth, sensor = read_map(build.depth), scene.sensors()[0]
    for v, u in ((3, 5), (17, 24), (30, 40)):
        ray, _ = sensor.sample_ray(0, 0, [(u + 0.5) / 48, (v + 0.5) / 36], [0.5, 0.5])
        # rays begin at the near plane, a millimetre along the axis
        assert abs(scene.ray_intersect(ray).t - depth[v, u]) < 0.005
