"""The annotation page's server: who may ask it for what, and what a page's commands do to the scene file. Without a browser."""

from __future__ import annotations

import asyncio
import http.client
import json
import os
import signal
import subprocess
import sys
import threading
import time

import pytest

pytest.importorskip("bokeh", reason="no Bokeh: make setup-annotate installs it")
from bokeh.document import Document  # noqa: E402

from pipeline.annotate.written.document import SceneDocument  # noqa: E402
from pipeline.annotate.page.studio import Studio  # noqa: E402
from pipeline.annotate.page.page import Page  # noqa: E402
from pipeline.annotate.page.server import ADDRESS, Server  # noqa: E402
from tests.annotate_fixture import PROJECT, Loop, StillPreview, scenes_with  # noqa: E402

TOKEN = "the-token"


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    root = tmp_path_factory.mktemp("server")
    scenes, running = scenes_with(root, "bathroom"), {}
    ready = threading.Event()

    def run():
        asyncio.set_event_loop(asyncio.new_event_loop())
        running["server"] = Server(scenes, root / "build", "bathroom", token=TOKEN, preview=StillPreview)
        running["server"].start()
        running["server"].loop.add_callback(ready.set)
        running["server"].loop.start()
        running["server"].stop()

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    assert ready.wait(20)
    yield running["server"]
    running["server"].loop.add_callback(running["server"].loop.stop)
    thread.join(10)


def ask(server, path, method="GET", body=None, drop=(), **headers):
    """Status and body of a request; headers as a browser on this server's page sends them, but for what is given."""
    sent = {"Host": f"{ADDRESS}:{server.port}", "Origin": f"http://{ADDRESS}:{server.port}"}
    sent.update({key.replace("_", "-"): value for key, value in headers.items()})
    connection = http.client.HTTPConnection(ADDRESS, server.port, timeout=60)
    connection.putrequest(method, path, skip_host=True)
    for key, value in sent.items():
        if key not in drop:
            connection.putheader(key, value)
    if body is not None:
        connection.putheader("Content-Length", str(len(body)))
    connection.endheaders()
    try:
        if body:
            connection.send(body)
        answer = connection.getresponse()
        return answer.status, answer.read()
    except (BrokenPipeError, ConnectionResetError):
        return 0, b""  # closed before it was all sent
    finally:
        connection.close()


# ---- who may ask -----------------------------------------------------------------------------------

def test_the_page_and_its_pictures_come_with_the_token(server):
    status, body = ask(server, f"/{TOKEN}/", drop=["Origin"])
    assert status == 200 and b'data-scene="bathroom"' in body and b"Content-Security-Policy" in body
    status, body = ask(server, f"/{TOKEN}/picture/bathroom/clear", drop=["Origin"])
    assert status == 200 and body[:3] == b"\xff\xd8\xff"


@pytest.mark.parametrize("path", ["/", "/wrong/", f"/{TOKEN[:-1]}/", f"/{TOKEN}x/", "/static/js/bokeh.min.js", "/picture/bathroom/clear",
                                  "/ws", "/upload", f"//{TOKEN}/", f"/%74{TOKEN[1:]}/"])
def test_nothing_without_the_token(server, path):
    assert ask(server, path)[0] == 404


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1", "127.0.0.1:1", "localhost.evil.example:{port}", "0.0.0.0:{port}", ""])
@pytest.mark.parametrize("path", [f"/{TOKEN}/", f"/{TOKEN}/static/js/bokeh.min.js", f"/{TOKEN}/picture/bathroom/clear"])
def test_a_name_that_points_here_is_refused(server, host, path):
    assert ask(server, path, Host=host.format(port=server.port))[0] == 403


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "https://127.0.0.1:{port}", "http://127.0.0.1:1", "http://127.0.0.1"])
def test_pages_of_the_web_are_refused(server, origin):
    assert ask(server, f"/{TOKEN}/", Origin=origin.format(port=server.port))[0] == 403
    assert ask(server, f"/{TOKEN}/upload?what=photograph&name=x", "POST", b"x", Origin=origin.format(port=server.port))[0] == 403
    assert ask(server, f"/{TOKEN}/ws", Origin=origin.format(port=server.port), **WEBSOCKET)[0] == 403


def test_pictures_for_other_sites_and_requests_without_origin_are_refused(server):
    assert ask(server, f"/{TOKEN}/picture/bathroom/clear", drop=["Origin"], Sec_Fetch_Site="cross-site")[0] == 403
    assert ask(server, f"/{TOKEN}/upload?what=photograph&name=x", "POST", b"x", drop=["Origin"])[0] == 403
    assert ask(server, f"/{TOKEN}/ws", drop=["Origin"], **WEBSOCKET)[0] == 403


WEBSOCKET = {"Upgrade": "websocket", "Connection": "Upgrade", "Sec_WebSocket_Version": "13", "Sec_WebSocket_Key": "dGhlIHNhbXBsZSBub25jZQ==",
             "Sec_WebSocket_Protocol": "bokeh, x"}


def test_only_this_machine_is_listened_to(server):
    assert [s.getsockname()[0] for s in server.server._http._sockets.values()] == ["127.0.0.1"]


# ---- scenes and uploads ------------------------------------------------------------------------------

@pytest.mark.parametrize("scene", ["../bathroom", "..", "%2e%2e", "nothing", "bath%00room", "/etc", ""])
def test_no_scene_outside_the_folder(server, scene):
    status, body = ask(server, f"/{TOKEN}/?scene={scene}", drop=["Origin"])
    assert status in (200, 400, 404) and (scene == "" or b"cannot be opened" in body or status != 200)
    assert ask(server, f"/{TOKEN}/picture/{scene}/clear", drop=["Origin"])[0] in (400, 404)


def nothing_left(server) -> bool:
    """Of uploads; the answer is sent a moment before its file is removed."""
    end = time.monotonic() + 10
    while list(server.studio.folder.glob("upload-*")) and time.monotonic() < end:
        time.sleep(0.02)
    return not list(server.studio.folder.glob("upload-*"))


def photograph(width=40, height=30) -> bytes:
    import cv2
    import numpy as np
    return cv2.imencode(".png", np.full((height, width, 3), 90, np.uint8))[1].tobytes()


def test_a_photograph_becomes_a_scene(server):
    status, body = ask(server, f"/{TOKEN}/upload?what=photograph&name=mine", "POST", photograph())
    assert (status, json.loads(body)) == (200, {"scene": "mine"})
    folder = server.studio.scenes / "mine"
    assert (folder / "scene.yaml").exists()
    before = {path: path.read_bytes() for path in folder.iterdir()}
    status, body = ask(server, f"/{TOKEN}/upload?what=photograph&name=mine", "POST", photograph(20, 20))
    assert status == 400 and {path: path.read_bytes() for path in folder.iterdir()} == before, "nothing is overwritten"


@pytest.mark.parametrize("name", ["../up", "a/b", "", ".hidden", "a" * 200, "inputs"])
def test_names_that_leave_the_folder(server, name):
    from urllib.parse import quote
    status, body = ask(server, f"/{TOKEN}/upload?what=photograph&name={quote(name, safe='')}", "POST", photograph())
    assert status == 400 and "name" in json.loads(body)["error"]


@pytest.mark.parametrize("body", [b"no picture", b"\xff\xd8\xff\xe0 cut off", b"\x89PNG\r\n\x1a\n" + b"\0" * 100, b"<svg/>"])
def test_what_is_no_photograph(server, body):
    status, said = ask(server, f"/{TOKEN}/upload?what=photograph&name=broken", "POST", body)
    assert status == 400 and json.loads(said)["error"] and not (server.studio.scenes / "broken").exists()
    assert nothing_left(server)


def test_a_picture_of_too_many_pixels_is_refused_by_its_header(server):
    import struct
    import zlib
    def chunk(name: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    bomb = (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", 60_000, 60_000, 8, 2, 0, 0, 0))
            + chunk(b"IDAT", zlib.compress(bytes(1000))) + chunk(b"IEND", b""))
    status, said = ask(server, f"/{TOKEN}/upload?what=photograph&name=bomb", "POST", bomb)
    assert status == 400 and any(word in json.loads(said)["error"] for word in ("megapixels", "header")), "not decoded"


def test_an_upload_that_is_too_large(server, monkeypatch):
    monkeypatch.setattr("pipeline.annotate.page.uploads.MOST_BYTES", 1000)
    assert ask(server, f"/{TOKEN}/upload?what=photograph&name=large", "POST", b"x" * 5000)[0] in (0, 400, 413)
    assert not (server.studio.scenes / "large").exists() and nothing_left(server)


def test_labels_of_another_size(server):
    status, said = ask(server, f"/{TOKEN}/upload?what=labels&scene=bathroom", "POST", photograph())
    assert status == 400 and not (server.studio.scenes / "bathroom/labels.png").exists()


# ---- what a page does --------------------------------------------------------------------------------

@pytest.fixture
def studio(tmp_path):
    loop = Loop()
    made = Studio(scenes_with(tmp_path, "bathroom"), tmp_path / "build", tmp_path / "own", "bathroom", loop, StillPreview)
    yield made
    made.close()


class Tab:
    """A page and its Bokeh document, without a browser; on: whether the browser is there."""

    def __init__(self, studio):
        self.on, self.desk, self.loop = True, studio.desk("bathroom"), studio.loop
        self.page = Page(self.desk, Document(), lambda: self.on)

    def do(self, what, **more):
        self.page.asked(json.dumps({"do": what, **more}))
        self.loop.turn()

    def click(self, *points):
        for x, y in points:
            self.page.guarded(self.page.tapped, x, y)
        self.loop.turn()

    @property
    def data(self):
        return self.desk.document.data


@pytest.fixture
def tab(studio):
    return Tab(studio)


def on_disk(studio) -> str:
    return (studio.scenes / "bathroom/scene.yaml").read_text()


def test_lines_one_after_the_other_and_saved(studio, tab):
    before = on_disk(studio)
    tab.do("add", kind="line_x")
    tab.click((10, 20), (110, 25), (10, 220), (110, 215))
    tab.do("cancel")
    assert tab.data["camera"]["lines"]["x"][-2:] == [[[10, 20], [110, 25]], [[10, 220], [110, 215]]]
    assert on_disk(studio) == before, "it waits for a moment of quiet"
    tab.loop.turn(delayed=True)
    after = on_disk(studio)
    assert "[[10, 20], [110, 25]]" in after.replace("10.0", "10") and "# this sets the scale" not in before or "sets the scale" in after
    assert SceneDocument.open(studio.scenes / "bathroom/scene.yaml").data == tab.data
    assert not tab.page.said


def test_undo_takes_back_one_drawing_and_redo_brings_it_again(tab):
    before = tab.data
    tab.do("add", kind="lamp")
    tab.click((10, 10), (40, 10), (40, 40), (10, 40))
    tab.do("finish")
    drawn = tab.data
    assert drawn["lights"]["lamp"]["outline"]["pixels"] == [[10, 10], [40, 10], [40, 40], [10, 40]]
    tab.do("undo")
    assert tab.data == before
    tab.do("redo")
    assert tab.data == drawn


def test_undo_in_a_drawing_takes_back_a_point(tab):
    tab.do("add", kind="lamp")
    tab.click((10, 10), (40, 10), (400, 400))
    tab.do("undo")
    tab.click((40, 40))
    tab.do("finish")
    assert tab.data["lights"]["lamp"]["outline"]["pixels"] == [[10, 10], [40, 10], [40, 40]]


def test_too_few_points_are_no_outline(tab):
    before = tab.data
    tab.do("add", kind="lamp")
    tab.click((10, 10), (40, 10))
    tab.do("finish")
    assert "2 of 3 points" in tab.page.said and tab.data == before


def test_a_box_corner_by_corner(tab):
    tab.do("add", kind="box")
    tab.click((100, 300), (150, 310), (100, 250))
    names = list(tab.data["shapes"]["box"]["corners"])
    assert names == ["front_left_bottom", "front_right_bottom", "front_left_top"]
    tab.do("option", name="corner", value="back_right_top")
    tab.click((160, 240))
    assert tab.data["shapes"]["box"]["corners"]["back_right_top"] == [160, 240]
    assert tab.data["shapes"]["box"]["stands_on"] == "room.floor"


def test_quick_clicks_at_two_places_are_two_points(tab):
    """Bokeh calls the second a double click."""
    tab.do("add", kind="lamp")
    tab.click((10, 10))
    tab.page.guarded(tab.page.double_tapped, 60, 10)
    tab.click((60, 60))
    tab.page.guarded(tab.page.double_tapped, 60, 60)
    assert tab.data["lights"]["lamp"]["outline"]["pixels"] == [[10, 10], [60, 10], [60, 60]]


def test_points_are_moved_inserted_and_deleted(tab):
    place = ["lights", "ceiling_lamp", "outline", "pixels"]
    tab.do("choose", place=place)
    points = tab.data["lights"]["ceiling_lamp"]["outline"]["pixels"]
    xs, ys = [p[0] for p in points], [p[1] for p in points]
    tab.page.dragged({"x": [xs[0] + 5, *xs[1:]], "y": ys})
    assert tab.data["lights"]["ceiling_lamp"]["outline"]["pixels"][0] == [xs[0] + 5, ys[0]]
    tab.page.picked([1])
    tab.do("insert")
    assert len(tab.data["lights"]["ceiling_lamp"]["outline"]["pixels"]) == 5
    tab.do("delete")
    assert len(tab.data["lights"]["ceiling_lamp"]["outline"]["pixels"]) == 4
    tab.page.point = None
    tab.do("delete")
    assert "ceiling_lamp" not in tab.data["lights"]


def test_values_are_checked_as_the_scene_file_is(tab):
    tab.do("choose", place=["lights", "ceiling_lamp", "outline", "pixels"])
    for text, says in (("abc", "give a number"), ("-1", "0 or more"), ("nan", "give a number")):
        tab.do("field", place=["lights", "ceiling_lamp", "gain"], value=text)
        assert says in tab.page.said
    tab.do("field", place=["lights", "ceiling_lamp", "gain"], value="0.5")
    assert tab.data["lights"]["ceiling_lamp"]["gain"] == 0.5 and not tab.page.said
    tab.do("field", place=["photograph", "file"], value="/etc/passwd")
    assert tab.data["photograph"]["file"] == "photograph.jpg", "only what the panel offers"
    tab.do("rename", value="big lamp")
    assert tab.page.said and "ceiling_lamp" in tab.data["lights"]
    tab.do("rename", value="big_lamp")
    assert "big_lamp" in tab.data["lights"] and tab.page.thing().owner == ("lights", "big_lamp")


def test_sliders_try_and_then_set(tab):
    tab.loop.turn(delayed=True)
    tab.do("slide", name="visibility", value=500)
    fog, gains = tab.desk.preview.asked[-1]
    assert (fog["visibility"], fog["g"], gains["sun"]) == (100.0, 0.25, 1.0), "the rest is the scene's"
    assert tab.data["fog"]["visibility"] == 12
    tab.do("slide", name="gain sun", value=0)
    fog, gains = tab.desk.preview.asked[-1]
    assert (fog["visibility"], gains["sun"], gains["sky"]) == (100.0, 0.0, 1.0)
    tab.do("slid", name="visibility", value=500)
    assert tab.data["fog"]["visibility"] == 100


@pytest.mark.parametrize("text", ["", "null", "[]", "{", '{"do": 1}', '{"do": "__init__"}', '{"do": "add", "kind": "x"}', '{"do": "slide"}',
                                  '{"do": "choose", "place": [[]]}', '{"do": "choose", "place": {"a": 1}}', '{"do": "slide", "name": "g", "value": "x"}',
                                  '{"do": "field", "place": ["a"], "value": null}', '{"do": "point", "by": "x"}', "x" * 30_000])
def test_nonsense_changes_nothing(tab, text):
    before = tab.data
    tab.page.asked(text)
    tab.loop.turn()
    assert tab.data == before and "terminal" not in tab.page.said


def test_clicks_and_drags_that_are_no_numbers(tab):
    before = tab.data
    tab.do("add", kind="line_x")
    tab.click((float("nan"), 1), (float("inf"), 2))
    tab.page.dragged({"x": [float("nan")], "y": [1.0]})
    assert tab.data == before and not tab.page.draft


# ---- two tabs, two editors ---------------------------------------------------------------------------

def test_a_second_tab_only_looks_until_it_asks(studio, tab):
    other = Tab(studio)
    before = tab.data
    other.do("add", kind="line_x")
    other.click((10, 20), (110, 25))
    other.do("undo")
    assert tab.data == before and "another tab" in other.page.said and "Edit here" in other.page.wire.panels["banner"]
    other.do("pen")
    other.do("add", kind="line_x")
    other.click((10, 20), (110, 25))
    assert tab.data != before
    tab.do("add", kind="line_y")
    assert "another tab" in tab.page.said, "the first one only looks now"


def test_a_tab_that_is_gone_leaves_the_pen(studio, tab):
    tab.on = False
    other = Tab(studio)
    assert other.page.may_write and not tab.page.may_write
    third = Tab(studio)
    other.page.leave()
    assert third.page.may_write


def test_the_persons_editor_is_followed(studio, tab):
    path = studio.scenes / "bathroom/scene.yaml"
    path.write_text(on_disk(studio).replace("visibility: 12 ", "visibility: 7 "))
    studio.look()
    assert tab.data["fog"]["visibility"] == 7 and not tab.desk.conflict


@pytest.mark.parametrize("keep", ["mine", "theirs"])
def test_both_changed_is_asked_and_nothing_lost_before(studio, tab, keep):
    path = studio.scenes / "bathroom/scene.yaml"
    theirs = on_disk(studio).replace("visibility: 12 ", "visibility: 7 ")
    tab.do("slid", name="visibility", value=500)
    path.write_text(theirs)
    tab.loop.turn(delayed=True)
    tab.page.draw({"state"})
    assert tab.desk.conflict and on_disk(studio) == theirs and "Take the file" in tab.page.wire.panels["banner"]
    tab.do("keep", value=keep)
    assert not tab.desk.conflict and tab.data["fog"]["visibility"] == (100 if keep == "mine" else 7)
    if keep == "mine":
        assert "visibility: 100" in on_disk(studio)
    else:
        assert on_disk(studio) == theirs


def test_a_file_that_is_broken_outside_is_said_and_the_page_keeps_what_it_has(studio, tab):
    before = tab.data
    (studio.scenes / "bathroom/scene.yaml").write_text("a: [")
    studio.look()
    assert tab.data == before and "scene.yaml" in tab.desk.fault


def test_names_are_shown_as_text(studio, tab):
    """A scene from a stranger puts no markup on the page."""
    with tab.desk.changing(tab.page) as document:
        document.set(("lights", "lamp"), {"type": "<img src=x onerror=alert(1)>", "outline": {"pixels": [[1, 1], [2, 2], [3, 1]]}})
        document.set(("camera", "fspy"), "<script>alert(1)</script>")
    tab.do("choose", place=["camera"])
    every = "".join(tab.page.wire.panels.values())
    assert "<img" not in every and "<script" not in every and "&lt;script&gt;" in every


# ---- killed at any moment ----------------------------------------------------------------------------

WRITER = """
import sys
from pathlib import Path
sys.path.insert(0, {project!r})
from pipeline.annotate.page.desk import Desk
from pipeline.annotate.written.document import SceneDocument
from tests.annotate_fixture import Loop, StillPreview
document = SceneDocument.open(Path({path!r}))
desk = Desk(document, StillPreview(None, None, None), (512, 512), Loop().add_callback, lambda s, c: None)
desk.pen = page = object()
for count in range(100000):
    with desk.changing(page):
        document.set(("fog", "visibility"), 10 + count)
        document.set(("camera", "lines", "y", 2), [[count, 1], [count, 400]])
    desk.save()
    print(10 + count, flush=True)
"""


def test_killed_while_it_saves(tmp_path):
    """What was said to be saved is there or newer, whole, and no half file lies about."""
    scenes = scenes_with(tmp_path, "bathroom")
    path = scenes / "bathroom/scene.yaml"
    for round in range(3):
        process = subprocess.Popen([sys.executable, "-c", WRITER.format(project=str(PROJECT), path=str(path))], stdout=subprocess.PIPE,
                                   text=True, env={**os.environ, "OMP_NUM_THREADS": "1"})
        said = 0
        for line in process.stdout:
            said = int(line)
            if said > 14 + 3 * round:
                time.sleep(0.003 * round)
                process.send_signal(signal.SIGKILL)
                break
        for line in process.stdout:
            said = int(line)
        process.wait()
        data = SceneDocument.open(path).data
        count = data["fog"]["visibility"]
        assert count >= said and data["camera"]["lines"]["y"][2] == [[count - 10, 1], [count - 10, 400]]
