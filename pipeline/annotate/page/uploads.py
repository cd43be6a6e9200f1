"""Files from the browser: a photograph for a new scene; a label image, or annotations of another program, for the one that is open.

The body goes to a file of the server's own folder piece by piece and is bounded; what it holds is decoded by the project's own reader
of photographs before it takes a place under scenes/. Its name in the browser is never used.
"""

from __future__ import annotations

import logging
import shutil
import uuid
from pathlib import Path

from tornado import web

from pipeline.errors import InputError
from pipeline.imaging import photograph as photographs
from pipeline.imaging.atomic import replacing
from pipeline.paths import checked_name

log = logging.getLogger(__name__)
#: Of an upload: an uncompressed float photograph of 16 megapixels; larger ones are copied into the scene's folder by hand.
MOST_BYTES = 200_000_000
LABELS = "labels.png"
#: Endings by what a file begins with; what is none of these is refused before it is decoded.
SIGNATURES = {b"\xff\xd8\xff": ".jpg", b"\x89PNG\r\n\x1a\n": ".png", b"II*\0": ".tif", b"MM\0*": ".tif", b"\x76\x2f\x31\x01": ".exr",
              b"#?RADIANCE": ".hdr", b"#?RGBE": ".hdr"}


@web.stream_request_body
class Upload(web.RequestHandler):
    """POST of a file's bytes; `what` is photograph (with `name`), labels or annotations (with `scene`). Answers in JSON."""

    def initialize(self, studio):
        self.studio = studio
        self.path = Path(studio.folder) / f"upload-{uuid.uuid4().hex}"
        self.written, self.file = 0, None

    def check_xsrf_cookie(self):
        """The guard has looked at Origin and token."""

    def prepare(self):
        self.request.connection.set_max_body_size(MOST_BYTES)
        if self.request.method == "POST":
            self.file = open(self.path, "wb")

    def data_received(self, chunk: bytes):
        self.written += len(chunk)
        if self.written > MOST_BYTES:
            raise web.HTTPError(413)
        self.file.write(chunk)

    async def post(self):
        self.file.close()
        what = self.get_query_argument("what", "")
        try:
            if what == "photograph":
                name = self.get_query_argument("name", "")
                await self.studio.loop.run_in_executor(None, self._photograph, name)
                self.finish({"scene": name})
            elif what == "labels":
                self._labels(self.get_query_argument("scene", ""))
                self.finish({"labels": LABELS})
            elif what == "annotations":
                self.finish({"said": self._annotations(self.get_query_argument("scene", ""))})
            else:
                raise InputError(f"what={what[:40]}", remedy="send a photograph, labels or annotations")
        except InputError as error:
            self.set_status(400)
            self.finish({"error": str(error)})

    def _photograph(self, name: str) -> None:
        from pipeline.annotate.written.new_scene import new_scene

        checked_name(name, "scene")
        path = self.path.with_suffix(_ending(self.path))
        self.path.rename(path)
        try:
            photographs.read(path)
            new_scene(self.studio.scenes, name, path)
        except InputError as error:
            # the temporary name says nothing to a person
            raise InputError(error.problem, remedy=error.remedy, place="the photograph") from None
        finally:
            path.unlink(missing_ok=True)

    def _desk(self, scene: str):
        desk = self.studio.desks.get(scene)
        if desk is None or desk.pen is None:
            raise InputError(f"no tab edits the scene '{scene[:40]}'", remedy="open it first")
        return desk

    def _annotations(self, scene: str) -> list[str]:
        """Imports a file of another program as one step; what came of each part, a line each."""
        from pipeline.annotate.exchange.importing import import_file

        desk = self._desk(scene)
        try:
            with desk.changing(desk.pen) as document:
                return import_file(document, self.path, desk.size)
        except InputError as error:
            raise InputError(error.problem, remedy=error.remedy, place="the file") from None

    def _labels(self, scene: str) -> None:
        desk = self._desk(scene)
        if _ending(self.path) != ".png":
            raise InputError("no PNG", place="the label image", remedy="save it as PNG, 8 bit, without soft edges")
        path = self.path.with_suffix(".png")
        self.path.rename(path)
        try:
            labels = photographs.read(path)
            if labels.codes.shape[:2] != desk.size[::-1]:
                height, width = labels.codes.shape[:2]
                raise InputError(f"{width} x {height} pixels", place="the label image",
                                 remedy=f"make it as large as the photograph, {desk.size[0]} x {desk.size[1]}")
            target = desk.document.path.parent / LABELS
            if target.exists() and target.read_bytes() != path.read_bytes():
                raise InputError("is there already", place=str(target), remedy="move it away first: nothing is overwritten")
            with replacing(target) as partial:
                shutil.copyfile(path, partial)
            with desk.changing(desk.pen) as document:
                document.set(("depth", "labels"), LABELS)
        finally:
            path.unlink(missing_ok=True)

    def on_finish(self):
        if self.file is not None:
            self.file.close()
        self.path.unlink(missing_ok=True)

    def on_connection_close(self):
        self.on_finish()


def _ending(path: Path) -> str:
    with open(path, "rb") as file:
        begins = file.read(16)
    for signature, ending in SIGNATURES.items():
        if begins.startswith(signature):
            return ending
    raise InputError("no photograph that is known", place="the upload", remedy="give a JPEG, PNG, TIFF, EXR or HDR file")
