"""A scene file that is changed by a page and by its person in turn: what is not meant stays, byte by byte."""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pipeline.annotate.written.document import Changed, SceneDocument
from pipeline.errors import InputError
from pipeline.scene.load import MAX_BYTES, load_scene, read_scene

PROJECT = Path(__file__).resolve().parent.parent
SHIPPED = sorted((PROJECT / "scenes").glob("*/scene.yaml"))

SOME = [path for path in SHIPPED if path.parent.name in ("bathroom", "building", "lobby", "sunroom")]

ROOM = """\
# a room
photograph: {file: 'photo.png'}   # by me

camera:
  height: 1.5    # m
  lines:
    x:
      - [[1, 2], [3.25, 4]]     # skirting board
      - [[5, 6], [7, 8]]
    y: [[[1, 1], [1, 9]]]

shapes:
  room:
    type: room
    corners: {back_left_floor: [10, 20],   # hidden by the chair
              back_right_floor: [30, 20]}
  # a chest
  chest:
    type: cuboid
    stands_on: room.floor
    corners:
      front_left_bottom: [1, 2]

lights:
  lamp:
    type: area
    outline:
      on: room.ceiling
      pixels: [[1, 2], [3, 4],
               [5, 6]]          # its shade
  sky: {type: sky}
  # a spare lamp?

fog: {type: homogeneous, visibility: 12}
# the end
"""


@pytest.fixture
def room(tmp_path) -> SceneDocument:
    path = tmp_path / "room" / "scene.yaml"
    path.parent.mkdir()
    path.write_text(ROOM)
    return SceneDocument.open(path)


def lines_changed(before: str, after: str) -> tuple[list[str], list[str]]:
    """Lines that went and lines that came."""
    old, new = before.splitlines(), after.splitlines()
    return [line for line in old if line not in new], [line for line in new if line not in old]


def places(value, where=()):
    if where:
        yield where
    if isinstance(value, (dict, list)):
        for key, one in value.items() if isinstance(value, dict) else enumerate(value):
            yield from places(one, (*where, key))


# ---- what stays ----------------------------------------------------------------------------------

@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.parent.name)
def test_setting_what_is_there_leaves_every_byte(path, tmp_path):
    copy = tmp_path / "scene.yaml"
    shutil.copy(path, copy)
    os.utime(copy, (1, 1))
    document = SceneDocument.open(copy)
    everywhere = list(places(document.data))
    for place in random.Random(path.parent.name).sample(everywhere, 25):
        document.set(place, document.get(place))
    assert not document.changed and not document.undo()
    document.save()
    assert copy.read_bytes() == path.read_bytes() and copy.stat().st_mtime == 1, "nothing is written anew"


@pytest.mark.parametrize("path", SOME, ids=lambda path: path.parent.name)
def test_any_change_is_taken_back_to_the_same_text(path):
    document = SceneDocument.open(path)
    text, chance = document.text, random.Random(path.parent.name)
    everywhere = [p for p in places(document.data) if len(p) > 1]
    for place in chance.sample(everywhere, 4):
        value = document.get(place)
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            document.set(place, value + 1.5)
        elif isinstance(value, list):
            document.set((*place, len(value)), value[-1])
        elif isinstance(value, dict):
            document.set((*place, "added"), {"type": "x", "pixels": [[1, 2], [3, 4]]})
        else:
            document.remove(place)
        after = document.text
        assert after != text
        comments = [line.partition(" #")[2] for line in text.splitlines() if " #" in line]
        assert sum(comment not in after for comment in comments) <= 1, "the removed value's own, at most"
        assert document.undo() and document.text == text
        assert document.redo() and document.text == after
        assert document.undo()


@pytest.mark.parametrize("path", SOME, ids=lambda path: path.parent.name)
def test_a_changed_scene_is_loaded_as_it_says(path, tmp_path):
    copy = tmp_path / "scene.yaml"
    shutil.copy(path, copy)
    document = SceneDocument.open(copy)
    document.set(("fogs", "new-one"), {"type": "homogeneous", "visibility": 33.3})
    document.set(("fog",), {"type": "height", "visibility": 7, "scale_height": 2})
    document.set(("composite", "exposure"), 0.25)
    document.save()
    scene = load_scene(copy, {}, "new-one")
    assert (scene.fog.visibility, scene.composite.exposure) == (33.3, 0.25)
    assert read_scene(copy).values == document.data
    gone, _ = lines_changed(path.read_text(), copy.read_text())
    assert all("fog" in line or "visibility" in line or "asymmetry" in line or "phase_function" in line
               or "type: he" in line or "type: ho" in line or "coefficient" in line for line in gone)


# ---- how it is written ---------------------------------------------------------------------------

def test_a_moved_point_changes_its_own_digits(room):
    room.set(("lights", "lamp", "outline", "pixels", 1), [3.14159, 4.0000001])
    assert lines_changed(ROOM, room.text) == (["      pixels: [[1, 2], [3, 4],"], ["      pixels: [[1, 2], [3.14, 4],"])
    assert room.get(("lights", "lamp", "outline", "pixels", 1)) == [3.14, 4]


def test_numbers_are_readable_and_those_of_a_person_stay(room):
    room.set(("camera", "height"), 1.23456789012)
    room.set(("shapes", "room", "corners", "back_left_floor"), (10.123456, 20.0))
    assert "height: 1.23457    # m" in room.text and "back_left_floor: [10.12, 20]," in room.text
    room.path.write_text(ROOM.replace("[10, 20]", "[10.123456, 20]"))
    room.reload()
    room.set(("shapes", "room", "corners", "back_left_floor"), [10.123456, 21])
    assert "[10.123456, 21]" in room.text


def test_added_and_removed_points_leave_comments(room):
    at = ("lights", "lamp", "outline", "pixels")
    room.set((*at, 3), [7, 8])
    assert "               [5, 6], [7, 8]]          # its shade" in room.text
    room.remove((*at, 0))
    assert "      pixels: [[3, 4],\n               [5, 6], [7, 8]]          # its shade" in room.text
    room.remove(("shapes", "room", "corners", "back_right_floor"))
    assert "# hidden by the chair" in room.text


def test_new_lines_and_things_are_written_as_people_write_them(room):
    room.set(("camera", "lines", "x", 2), [[1.001, 2], [3, 4]])
    room.set(("camera", "lines", "z"), [[[1, 2], [3, 4]], [[5, 6], [7, 9]]])
    room.set(("lights", "window"), {"type": "area", "outline": {"on": "room.left", "pixels": [[1, 2], [3, 4], [5, 6]]}})
    room.set(("illumination",), {"type": "karsch", "albedos": [{"pixels": [[1, 2], [3, 4], [5, 6]], "albedo": [0.5, 0.5, 0.5]}]})
    _, came = lines_changed(ROOM, room.text)
    assert "\n".join(came) == """\
      - [[1, 2], [3, 4]]
    z:
      - [[1, 2], [3, 4]]
      - [[5, 6], [7, 9]]
  window:
      on: room.left
      pixels: [[1, 2], [3, 4], [5, 6]]
illumination:
  type: karsch
  albedos:
    - {pixels: [[1, 2], [3, 4], [5, 6]], albedo: [0.5, 0.5, 0.5]}"""
    assert "      pixels: [[1, 2], [3, 4], [5, 6]]\n  # a spare lamp?\n\nillumination:" in room.text
    assert "  sky: {type: sky}\n  window" in room.text and "\n\nillumination:" in room.text
    assert room.text.index("illumination:") < room.text.index("\nfog:") and room.text.endswith("# the end\n")


def test_long_outlines_are_wrapped(room):
    room.set(("lights", "lamp", "outline", "pixels"), [[1000 + n, 2000.5] for n in range(60)])
    new = [line for line in room.text.splitlines() if "2000.5" in line]
    assert max(len(line.partition("  #")[0]) for line in new) <= 120 and len(new) > 5 and room.text.count("# its shade") == 1
    assert {line.index("[1") for line in new[1:]} == {new[0].index("[[") + 1}


def test_order_of_regions_is_kept_or_changed_as_asked(room):
    room.set(("depth", "regions"), {"sky": {"class": "sky", "pixels": [[0, 0], [9, 0], [9, 5]]},
                                    "tree": {"class": "vertical", "pixels": [[1, 1], [2, 1], [2, 5]]}})
    regions = room.get(("depth", "regions"))
    room.set(("depth", "regions"), {"tree": regions["tree"], "sky": regions["sky"]})
    assert list(room.get(("depth", "regions"))) == ["tree", "sky"] and room.text.index("    tree:") < room.text.index("    sky:")
    camera = room.get(("camera",))
    before = room.text
    room.set(("camera",), dict(reversed(camera.items())))
    assert room.text == before, "of other groups the order says nothing"


def test_empty_groups_go_with_what_was_in_them(room):
    room.remove(("shapes", "chest", "corners", "front_left_bottom"))
    assert "corners" not in room.get(("shapes", "chest"))
    for thing in ("room", "chest"):
        room.remove(("shapes", thing))
    assert "shapes" not in room.data
    room.remove(("lights", "sun"))  # is not there
    for section in ("camera", "lights", "fog"):
        room.remove((section,))
    with pytest.raises(InputError, match="nothing would be left of the scene"):
        room.remove(("photograph",))


@pytest.mark.parametrize("end", ["\r\n", "\n"])
@pytest.mark.parametrize("begin", ["", "\ufeff"])
def test_line_ends_and_byte_order_mark_stay(tmp_path, begin, end):
    path = tmp_path / "scene.yaml"
    path.write_bytes((begin + ROOM).replace("\n", end).encode())
    document = SceneDocument.open(path)
    document.set(("camera", "height"), 2)
    document.set(("lights", "bulb"), {"type": "point", "position": {"pixel": [1, 2], "depth": 3}})
    document.save()
    written = path.read_bytes().decode()
    assert written.startswith(begin + "# a room") and written.count("\n") == written.count(end)
    assert read_scene(path).values == document.data


@pytest.mark.parametrize("value", ["yes", "null", "1", "#ff8000", "a: b", "it's", "", " x", "a\nb", "[", "é", "-", "2024-01-01"])
def test_words_come_back_as_they_were(room, value):
    room.set(("fogs", "thin"), {"type": value, "list": [value, "x"]})
    room.set(("photograph", "file"), value)
    again = SceneDocument(room.path, room.text)
    assert again.get(("fogs", "thin")) == {"type": value, "list": [value, "x"]} and again.get(("photograph", "file")) == value


ODD = """\
a: 1
b:
- x: 1
  y: [1, 2]   # k
-   - 3
    - 4
- - - 5
    - 6
  - 7
c:   # empty
d: {e: , f: 2}
"g h": 'it''s'
i: |
  text
  more

k: &anchor
  l: 1
m: [ # first
  [1, 2], # one
  [3, 4]  # two
  ]
n:

  # before
  o: 1

  # between
  p: 2   # after
# end
"""


@pytest.mark.parametrize("seed", range(3))
def test_odd_ways_of_writing(tmp_path, seed):
    """Of random changes each holds what was asked (`set` reads it again), keeps what it can, and is taken back."""
    chance = random.Random(seed)
    document, states = SceneDocument(tmp_path / "scene.yaml", ODD), [ODD]
    values = [3.5, None, "a: b", [], [[1, 2], [3, 4]], {"q": {"r": 1}}, [{"s": [1, 2]}, 3], {}]
    for _ in range(25):
        place = chance.choice([p for p in places(document.data)])
        old = document.get(place)
        if chance.random() < 0.3:
            document.remove(place)
        elif isinstance(old, list) and chance.random() < 0.5:
            document.set((*place, len(old)), chance.choice(values))
        else:
            value = chance.choice(values)
            document.set(place, value)
            assert document.get(place) == value
        states += [document.text] * (document.text != states[-1])
    assert len(states) > 10 and "# end" in document.text
    for state in reversed(states[:-1]):
        assert document.undo() and document.text == state


# ---- names ----------------------------------------------------------------------------------------

def test_rename_leads_references_along(room):
    room.rename(("shapes", "room"), "hall")
    assert room.get(("shapes", "chest", "stands_on")) == "hall.floor"
    assert room.get(("lights", "lamp", "outline", "on")) == "hall.ceiling"
    gone, came = lines_changed(ROOM, room.text)
    assert len(gone) == len(came) == 3 and list(room.get(("shapes",))) == ["hall", "chest"]
    assert room.undo() and room.text == ROOM and not room.undo()


def test_rename_of_a_region_leads_patches_along(room):
    room.set(("depth", "regions", "house"), {"class": "vertical", "pixels": [[1, 1], [2, 1], [2, 5]]})
    room.set(("illumination",), {"type": "liu_xing", "shadowed": [{"pixel": [1, 2], "on": "house"}, {"pixel": [1, 2]}]})
    room.rename(("depth", "regions", "house"), "barn")
    assert room.get(("illumination", "shadowed")) == [{"pixel": [1, 2], "on": "barn"}, {"pixel": [1, 2]}]


@pytest.mark.parametrize("place, name, said", [
    (("lights", "lamp"), "sky", "'sky' is there already"),
    (("lights", "lamp"), "two words", "'two words' is no name"),
    (("lights", "lamp"), "a" * 41, "is no name"),
    (("lights", "lamp", "outline"), "shade", "nothing here has a name of its own"),
    (("lights", "moon"), "sun", "nothing here has a name of its own"),
])
def test_names_that_cannot_be(room, place, name, said):
    with pytest.raises(InputError, match=said):
        room.rename(place, name)
    assert room.text == ROOM


# ---- steps ------------------------------------------------------------------------------------------

def test_several_changes_are_one_step(room):
    with room.step():
        room.set(("camera", "height"), 2)
        with room.step():
            room.remove(("lights", "sky"))
    assert room.undo() and room.text == ROOM and not room.undo()
    assert room.redo() and room.get(("camera", "height")) == 2 and not room.redo()


def test_a_failed_step_changes_nothing(room):
    room.set(("camera", "height"), 3)
    before = room.text
    with pytest.raises(InputError, match="no entry 9 in a list of 2"), room.step():
        room.set(("camera", "height"), 2)
        room.set(("camera", "lines", "x", 9), [[1, 2], [3, 4]])
    assert room.text == before and room.undo() and room.text == ROOM


def test_a_change_after_undo_forgets_what_was_undone(room):
    room.set(("camera", "height"), 2)
    room.undo()
    room.set(("camera", "height"), 3)
    assert not room.redo() and room.undo() and room.text == ROOM


# ---- the file on the disk -----------------------------------------------------------------------------

def test_somebody_elses_changes_are_never_lost_unseen(room):
    other = SceneDocument.open(room.path)
    other.set(("camera", "height"), 9)
    other.save()
    room.set(("camera", "height"), 2)
    with pytest.raises(Changed, match="was changed by somebody else since it was opened or saved; load it again, or save over it"):
        room.save()
    assert "height: 9" in room.path.read_text() and room.changed and room.changed_on_disk()
    room.reload()
    assert room.get(("camera", "height")) == 9 and not room.changed
    assert room.undo() and room.get(("camera", "height")) == 2 and room.changed
    room.save()
    assert "height: 2" in room.path.read_text() and not room.changed
    with pytest.raises(Changed):
        other.set(("camera", "height"), 4)
        other.save()
    other.save(overwrite=True)
    assert "height: 4" in room.path.read_text()
    room.path.unlink()
    with pytest.raises(Changed, match="was removed"):
        room.set(("camera", "height"), 5)
        room.save()
    room.save(overwrite=True)
    assert "height: 5" in room.path.read_text()


def test_save_keeps_mode_and_link(room, tmp_path):
    link = tmp_path / "scene.yaml"
    link.symlink_to(room.path)
    room.path.chmod(0o640)
    document = SceneDocument.open(link)
    document.set(("camera", "height"), 2)
    document.save()
    assert link.is_symlink() and "height: 2" in room.path.read_text() and room.path.stat().st_mode & 0o777 == 0o640
    assert sorted(p.name for p in room.path.parent.iterdir()) == ["scene.yaml"]


KILLED = """
import sys
from pathlib import Path
from pipeline.annotate.written.document import SceneDocument
document = SceneDocument.open(Path(sys.argv[1]))
print("opened", flush=True)
while True:
    for height in (2, 3):
        document.set(("camera", "height"), height)
        document.save()
"""


def test_a_kill_at_any_moment_leaves_a_whole_file(room):
    whole = {ROOM.replace("height: 1.5", f"height: {height}") for height in (1.5, 2, 3)}
    for wait in (0.0, 0.011, 0.03, 0.073):
        process = subprocess.Popen([sys.executable, "-c", KILLED, room.path], cwd=PROJECT, stdout=subprocess.PIPE,
                                   env={**os.environ, "PYTHONPATH": str(PROJECT)})
        assert process.stdout.readline() == b"opened\n"
        time.sleep(wait)
        process.send_signal(signal.SIGKILL)
        process.communicate()
        assert room.path.read_text() in whole


# ---- what is refused ----------------------------------------------------------------------------------

@pytest.mark.parametrize("content, said", [
    ("a: &x [1]\nb: *x\n", "YAML alias"),
    ("a: !!python/object:os.system {}\n", "YAML tag"),
    ("a: 1\na: 2\n", "stated twice"),
    ("a: [1\n", "not valid YAML"),
    ("- 1\n", "not a group of 'name: value' lines"),
    ("", "is empty"),
    ("a: " + "[" * 60 + "]" * 60, "nested too deeply"),
    ("a: " + "x" * MAX_BYTES, "scene file of"),
    (b"\xff\xfe\x00", "cannot be read"),
])
def test_hostile_files_are_refused_as_by_the_loader(tmp_path, content, said):
    path = tmp_path / "scene.yaml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    for read in (SceneDocument.open, read_scene):
        with pytest.raises(InputError, match=said):
            read(path)


def test_no_file(tmp_path):
    with pytest.raises(InputError, match="no such scene file"):
        SceneDocument.open(tmp_path / "x" / "scene.yaml")


@pytest.mark.parametrize("place, value, said", [
    (("camera", "height", "x"), 1, "a value has no entry 'x'"),
    (("camera", "lines", "x", -1), 1, "no entry -1 in a list of 2; count from 0 to 2"),
    (("camera", "lines", "x", "first"), 1, "no entry 'first' in a list of 2"),
    (("camera", 0), 1, "a group has no entry 0"),
    ((), 1, "the scene is a group"),
    (("camera", "height"), float("nan"), "nan is no finite number"),
    (("camera", "height"), object(), "a value of type object"),
    (("camera", "height"), {1: 2}, "1 as a name"),
    (("fog", "note"), [[0] * 1000] * 201, "would hold more than 200000 values"),
    (("fog", "note"), json.loads("[" * 500 + "]" * 500), "nested more than 50 groups or lists deep"),
    (("fog", "note"), json.loads("[" * 49 + "]" * 49), "nested more than 50 groups or lists deep"),
    (("fog", "note"), "x" * MAX_BYTES, "would be larger than 2000000 bytes"),
    (("a",) * 60, 1, "60 keys deep, more than 50"),
])
def test_changes_that_cannot_be(room, place, value, said):
    with pytest.raises(InputError, match=said):
        room.set(place, value)
    assert room.text == ROOM and not room.changed and not room.undo()
