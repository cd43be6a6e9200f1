"""The scene in other programs' languages."""

import xml.etree.ElementTree as ElementTree

from pipeline.cli import main
from tests.test_light_transport import DESCRIBED, chain


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
