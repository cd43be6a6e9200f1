"""A scene on the desk: its document, what the preview says of it, and the pages that look at it.

All of it happens on the server's one thread, but for what computes: that runs in threads of its own, always on the newest scene, and
comes back as a call on the server's thread. What changed is told to every page by name: `document`, `shown`, `picture`, `state`.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from pipeline.annotate.page.fog_sliders import stated
from pipeline.errors import InputError

log = logging.getLogger(__name__)
#: Seconds of quiet after which a change is saved, and after which light and fog are worked out anew.
SAVE_AFTER, ESTIMATE_AFTER = 0.4, 0.15
#: Seconds that a slider rests before its picture has all its pixels.
WHOLE_AFTER = 0.25
#: Seconds between looks at the file, which a person's editor may have changed.
LOOK_EVERY = 1.0
#: JPEG of the foggy picture on its way to a browser on the same machine.
QUALITY = 90


class Newest:
    """Runs `work` in a thread on the newest of what it is given; what came between is left out.

    loop(call) runs a call on the server's thread. done(result, error) is called there, one of the two None.
    """

    def __init__(self, executor: ThreadPoolExecutor, loop: Callable, work: Callable, done: Callable):
        self.executor, self.loop, self.work, self.done = executor, loop, work, done
        self.waiting, self.running = None, False

    def give(self, *given) -> None:
        self.waiting = given
        if not self.running:
            self._start()

    def _start(self) -> None:
        given, self.waiting, self.running = self.waiting, None, True
        self.executor.submit(self._run, given)

    def _run(self, given) -> None:
        result = error = None
        try:
            result = self.work(*given)
        except Exception as fault:  # told on the page; a thread that ends would leave the page waiting
            error = fault
            if not isinstance(fault, InputError):
                log.exception("the preview failed")
        self.loop(lambda: self._finished(result, error))

    def _finished(self, result, error) -> None:
        self.running = False
        self.done(result, error)
        if self.waiting is not None and not self.running:
            self._start()


class Desk:
    """One scene that is being annotated. `later(seconds, call)` and `loop(call)` are the server's."""

    def __init__(self, document, preview, size: tuple[int, int], loop: Callable, later: Callable):
        self.document, self.preview, self.size = document, preview, size
        self.loop, self.later = loop, later
        self.shown: Any = None
        self.geometry_problems: list = []
        self.estimate_problems: list = []
        self.picture: bytes | None = None
        self.picture_count = 0
        self.fault = ""
        self.conflict = False
        self.estimating = False
        self.tried: tuple[dict, dict] = stated(document.data)
        self.pages: list = []
        self.pen: Any = None
        self.render: Any = None
        self.version = 0
        quick, slow = ThreadPoolExecutor(1, "geometry"), ThreadPoolExecutor(1, "estimate")
        self.executors = (quick, slow)
        self._geometry = Newest(quick, loop, preview.geometry, self._placed)
        self._fog = Newest(quick, loop, self._jpeg, self._pictured)
        self._estimate = Newest(slow, loop, lambda data: preview.estimate(data, lambda: loop(self._roughly)), self._estimated)
        self._stamp = self._file_stamp()
        self._recompute()

    # ---- pages ---------------------------------------------------------------------------------
    def join(self, page) -> None:
        """The first page may write; where the one that may is gone from the screen, the next."""
        self.pages.append(page)
        if self.pen is None or not self.pen.present():
            self.give_pen(page)

    def leave(self, page) -> None:
        self.pages = [one for one in self.pages if one is not page]
        if self.pen is page:
            self.pen = None
            if self.pages:
                self.give_pen(self.pages[-1])

    def give_pen(self, page) -> None:
        self.pen = page
        self.tell("state")

    def tell(self, *what: str) -> None:
        for page in list(self.pages):
            page.told(set(what))

    # ---- changes -------------------------------------------------------------------------------
    @contextmanager
    def changing(self, page):
        """One undo step by a page that may write. InputError otherwise, and whatever the document refuses."""
        self.must_hold_pen(page)
        with self.document.step():
            yield self.document
        self.changed()

    def must_hold_pen(self, page) -> None:
        if page is not self.pen:
            raise InputError("another tab edits this scene", remedy="press 'Edit here' first")

    def changed(self) -> None:
        """After every change of the document, undo and redo among them."""
        self.version += 1
        version = self.version
        self._recompute()
        self.later(SAVE_AFTER, lambda: self.save() if version == self.version else None)
        self.tell("document", "state")

    def _recompute(self) -> None:
        version, data = self.version, self.document.data
        self._geometry.give(data)
        if self.picture is not None and stated(data) != self.tried:
            self.show_fog(*stated(data))  # at once, from the maps that are there; exact ones follow
        self.later(ESTIMATE_AFTER, lambda: self._estimate_now() if version == self.version else None)

    def _estimate_now(self) -> None:
        if self._estimate.running:
            self.preview.cancel()
        self.estimating = True
        self._estimate.give(self.document.data)
        self.tell("state")

    # ---- the file ------------------------------------------------------------------------------
    def save(self, overwrite: bool = False) -> None:
        """Writes what was changed; where the file is no longer what was read, the page asks which to keep."""
        if not self.document.changed and not overwrite:
            return
        try:
            self.document.save(overwrite=overwrite)
            self.conflict, self.fault = False, ""
        except InputError as error:
            self.conflict = self.document.changed_on_disk()
            self.fault = "" if self.conflict else str(error)
        else:
            self._stamp = self._file_stamp()
        self.tell("state")

    def look(self) -> None:
        """Takes up what the person's editor wrote, where the page has nothing unsaved."""
        stamp = self._file_stamp()
        if stamp == self._stamp or stamp is None:
            return
        if not self.document.changed_on_disk():
            self._stamp = stamp
            return
        if self.document.changed:
            if not self.conflict:
                self.conflict = True
                self.tell("state")
            return
        self.take_theirs()

    def take_theirs(self) -> None:
        stamp = self._file_stamp()
        try:
            self.document.reload()
        except InputError as error:
            self.fault, self._stamp = str(error), stamp
            self.tell("state")
            return
        self._stamp, self.conflict, self.fault = stamp, False, ""
        self.version += 1
        self._recompute()
        self.tell("document", "state")

    def _file_stamp(self):
        try:
            stat = self.document.path.stat()
        except OSError:
            return None
        return stat.st_mtime_ns, stat.st_size, stat.st_ino

    # ---- what comes back from the threads ------------------------------------------------------
    def _placed(self, result, error) -> None:
        if error is None:
            self.shown, self.geometry_problems = result
        else:
            self.fault = str(error)
        self.tell("shown")

    def _estimated(self, problems, error) -> None:
        if self._estimate.waiting is not None:
            return  # stopped for a newer one, which follows
        self.estimating = False
        if error is None:
            self.estimate_problems = [one for one in problems if one not in self.geometry_problems]
            self.show_fog(*stated(self.document.data))
        else:
            self.fault = str(error)
        self.tell("shown", "state")

    def _roughly(self) -> None:
        if self._estimate.waiting is None:
            self.show_fog(*stated(self.document.data))

    def show_fog(self, fog: dict, gains: dict, quickly: bool = False) -> None:
        """The foggy picture with these of the fog's values and lights' gains, from the maps that are there; quickly: first with
        fewer pixels, for more are to follow."""
        self.tried = (fog, gains)
        self._fog.give(fog or None, gains or None, quickly)

    def _jpeg(self, fog, gains, quickly) -> tuple[bytes, bool]:
        picture = np.asarray(self.preview.foggy(fog, gains, quickly))
        return cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes(), quickly

    def _pictured(self, result, error) -> None:
        if error is None:
            self.picture, quickly = result
            self.picture_count += 1
            if quickly and self._fog.waiting is None:
                count = self.picture_count
                self.later(WHOLE_AFTER, lambda: self.show_fog(*self.tried) if count == self.picture_count else None)
        elif not isinstance(error, InputError):
            self.fault = str(error)
        self.tell("picture")

    @property
    def problems(self) -> list:
        """What is wrong, first what is worst; each once."""
        every = {(one.place, one.message): one for one in [*self.geometry_problems, *self.estimate_problems]}
        return sorted(every.values(), key=lambda one: one.severity != "error")

    def close(self) -> None:
        self.save()
        self.preview.cancel()
        for executor in self.executors:
            executor.shutdown(wait=True, cancel_futures=True)
        self.preview.close()


def photograph_picture(path: Path, colour_space: str, max_megapixels: float, pixels: float) -> tuple[tuple[int, int], bytes]:
    """Width and height of the photograph, and a JPEG of it with at most `pixels` pixels, as a screen shows it."""
    from pipeline.imaging import photograph as photographs
    from pipeline.imaging.display import FLOAT_KINDS, display_exposure, displayed, shrunk

    photograph = photographs.read(path, colour_space, int(max_megapixels * 1e6))
    height, width = photograph.radiance.shape[:2]
    longest = max(1, round(max(width, height) * min(1.0, (pixels / (width * height)) ** 0.5)))
    exposure = display_exposure(photograph.radiance) if path.suffix.lower() in FLOAT_KINDS else 1.0
    shown = displayed(shrunk(photograph.radiance, longest), exposure)
    return (width, height), cv2.imencode(".jpg", shown[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 92])[1].tobytes()
