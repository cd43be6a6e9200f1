"""A fog that is written into a person's scene file: nothing else there changes."""

from __future__ import annotations

import difflib

import pytest

from pipeline.errors import InputError
from pipeline.scene.fog_entry import OURS, refuse_taken, write_fog
from pipeline.scene.load import load_scene, read_scene

FOG = {"type": "homogeneous", "visibility": 7.5, "single_scattering_albedo": [0.9, 0.95, 1.0],
       "phase_function": {"type": "isotropic"}}
FOGS = "fogs:\n  thick:\n    type: homogeneous\n    visibility: 2\n"


def written(scene, name="matched", remark="of foggy.jpg"):
    return write_fog(scene.file, name, FOG, remark)


def added(before: str, after: str) -> list[str]:
    """Lines that came; none may go."""
    changes = [line for line in difflib.ndiff(before.splitlines(), after.splitlines()) if line[0] in "+-"]
    assert not [line for line in changes if line[0] == "-"], changes
    return [line[2:] for line in changes]


@pytest.mark.parametrize("fogs", [
    FOGS, FOGS.replace("fogs:", "fogs:      # mine\n  # and a remark"), FOGS + "  # the last word\n\n",
    FOGS.replace("visibility: 2", "visibility: 2   # dense"), FOGS.replace("  thick", "    thick").replace("    type", "        type")
        .replace("    vis", "        vis"),
    "fogs:\n  thick: {type: homogeneous,\n          visibility: 2}\n"], ids=range(6))
def test_entry_joins_the_others(fogs, tiny_scene):
    tiny_scene.replace(FOGS, fogs)
    before = tiny_scene.file.read_text()
    line = written(tiny_scene)
    entry, = added(before, tiny_scene.file.read_text())
    assert tiny_scene.file.read_text().splitlines()[line - 1] == entry and entry.endswith(f"   {OURS} of foggy.jpg")
    scene = load_scene(tiny_scene.file, fog="matched")
    assert scene.fog.visibility == 7.5 and scene.fogs["thick"].visibility == 2 and scene.render.samples == 8


@pytest.mark.parametrize("fogs", ["fogs: {thick: {type: homogeneous, visibility: 2}}\n", "fogs: {}\n",
                                  "fogs: {thick: {type: homogeneous, visibility: 2}}  # one\n",
                                  "fogs: {\n  thick: {type: homogeneous, visibility: 2}\n  }\n"])
def test_entry_goes_between_braces(fogs, tiny_scene):
    tiny_scene.replace(FOGS, fogs)
    written(tiny_scene)
    written(tiny_scene, "second")
    scene = load_scene(tiny_scene.file, fog="second")
    assert list(scene.fogs) == (["thick"] if "thick" in fogs else []) + ["matched", "second"]
    assert ("# one" in fogs) == ("# one" in tiny_scene.file.read_text())


def test_scene_without_named_fogs(tiny_scene):
    tiny_scene.replace(FOGS, "")
    tiny_scene.file.write_text(tiny_scene.file.read_text().rstrip("\n"))
    before = tiny_scene.file.read_text()
    written(tiny_scene)
    assert [line for line in added(before, tiny_scene.file.read_text()) if line][0] == "fogs:"
    assert load_scene(tiny_scene.file, fog="matched").fog.visibility == 7.5


def test_fogs_at_the_end_without_a_last_line_end(tiny_scene):
    text = tiny_scene.file.read_text().replace(FOGS, "") + FOGS.rstrip("\n")
    tiny_scene.file.write_text(text)
    written(tiny_scene)
    assert tiny_scene.file.read_text().startswith(text + "\n") and load_scene(tiny_scene.file, fog="matched")


def test_line_ends_of_another_system_stay(tiny_scene):
    tiny_scene.file.write_bytes(tiny_scene.file.read_bytes().replace(b"\n", b"\r\n"))
    for remark in ("of a.jpg", "of b.jpg"):
        written(tiny_scene, remark=remark)
    assert tiny_scene.file.read_bytes().count(b"\n") == tiny_scene.file.read_bytes().count(b"\r\n") > 30
    assert b"of b.jpg\r\n" in tiny_scene.file.read_bytes()


def test_own_entry_is_replaced_and_a_persons_is_not(tiny_scene):
    written(tiny_scene)
    before = tiny_scene.file.read_text()
    assert write_fog(tiny_scene.file, "matched", {**FOG, "visibility": 9.0}, "of other.jpg")
    assert tiny_scene.file.read_text() == before.replace("7.5", "9.0").replace("foggy.jpg", "other.jpg")
    with pytest.raises(InputError, match=f"scene.yaml:{tiny_scene.line('thick:')}: a fog is called 'thick' already, and not by an "
                                         "earlier match; give another name: to=NAME"):
        refuse_taken(tiny_scene.file, "thick")
    tiny_scene.replace(OURS, "# mine now")
    kept = tiny_scene.file.read_text()
    with pytest.raises(InputError, match="'matched' already"):
        written(tiny_scene)
    assert tiny_scene.file.read_text() == kept


@pytest.mark.parametrize("name", ["inputs", "match", "9x", "a b", "a/b", "", "x" * 41, "a..b", "a\nb"])
def test_names_that_no_fog_may_have(name, tiny_scene):
    with pytest.raises(InputError, match="is no fog's name; use letters"):
        refuse_taken(tiny_scene.file, name)


def test_values_that_a_scene_refuses_leave_the_file_alone(tiny_scene):
    before = tiny_scene.file.read_bytes()
    with pytest.raises(InputError, match="visibility = -1"):
        write_fog(tiny_scene.file, "matched", {**FOG, "visibility": -1.0}, "")
    assert tiny_scene.file.read_bytes() == before


def test_remarks_cannot_leave_their_line(tiny_scene):
    written(tiny_scene, remark="of a\nfog: {type: x}\u2028b: c\r.jpg")
    assert read_scene(tiny_scene.file).values["fog"]["visibility"] == 6
    assert sum(OURS in line for line in tiny_scene.file.read_text().splitlines()) == 1


def test_what_cannot_be_added_to_is_left_alone(tiny_scene):
    """Behind the document's end nothing belongs to it."""
    tiny_scene.replace(FOGS, "")
    tiny_scene.file.write_text(tiny_scene.file.read_text() + "...\n")
    before = tiny_scene.file.read_text()
    with pytest.raises(InputError, match="add it yourself: matched: {type: homogeneous, visibility: 7.5"):
        written(tiny_scene)
    assert tiny_scene.file.read_text() == before


def test_links_and_permissions_stay(tiny_scene):
    real = tiny_scene.folder / "real.yaml"
    tiny_scene.file.rename(real)
    real.chmod(0o640)
    tiny_scene.file.symlink_to("real.yaml")
    written(tiny_scene)
    assert tiny_scene.file.is_symlink() and "matched" in real.read_text() and real.stat().st_mode & 0o777 == 0o640
