"""`make scene=NAME` for the page's button: its progress, its end, its picture."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import threading
import time
from collections.abc import Callable

import cv2

from pipeline.errors import InputError
from pipeline.paths import PROJECT, Build

#: In the order in which make does them; a line of its output begins with the stage's name.
STAGES = ("resolve", "photograph", "camera", "geometry", "sun_direction", "illumination", "plan", "emit", "render", "decompose",
          "composite", "report")
#: Longer side of the result on the page [pixel].
LONGEST = 2000
#: Of the environment nothing of an outer make may reach the inner one.
OUTER = re.compile(r"(FOG_.*|MAKE.*|MFLAGS|scene|fog|port|photo)$")


class RenderJob:
    """One render at a time. loop(call) runs a call on the server's thread; told() says that something changed."""

    def __init__(self, build: Build, loop: Callable, told: Callable):
        self.build, self.loop, self.told = build, loop, told
        self.process: subprocess.Popen | None = None
        self.running, self.stopped = False, False
        self.progress, self.said, self.error, self.seconds = 0.0, "", "", 0.0
        self.finished = False
        self.picture: bytes | None = None
        self.count = 0

    def start(self) -> None:
        if self.running:
            raise InputError("it is being rendered already", remedy="wait, or stop it first")
        self.running, self.stopped, self.finished = True, False, False
        self.progress, self.said, self.error = 0.0, "begins", ""
        environment = {key: value for key, value in os.environ.items() if not OUTER.match(key)}
        command = ["make", "--no-print-directory", f"scene={self.build.scene}", f"SCENES={self.build.scenes}",
                   f"BUILD={self.build.builds}"]
        try:
            self.process = subprocess.Popen(command, cwd=PROJECT, env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                                            stderr=subprocess.STDOUT, text=True, errors="replace", start_new_session=True)
        except OSError as error:
            self.running = False
            raise InputError(f"make could not be started: {error.strerror}", remedy="install make") from None
        threading.Thread(target=self._follow, args=(self.process, time.monotonic()), daemon=True).start()
        self.told()

    def stop(self) -> None:
        """Ends make and all that it started; what is finished is kept."""
        if self.process is not None and self.running:
            self.stopped = True
            try:
                os.killpg(self.process.pid, signal.SIGINT)
            except ProcessLookupError:
                pass

    def _follow(self, process: subprocess.Popen, began: float) -> None:
        last = ""
        for line in process.stdout:
            line = line.strip()[:300]
            last = line if line.startswith("error:") or not last.startswith("error:") else last
            self.loop(lambda line=line: self._heard(line))
        status = process.wait()
        picture = self._result() if status == 0 else None
        self.loop(lambda: self._ended(status, last, round(time.monotonic() - began, 1), picture))

    def _heard(self, line: str) -> None:
        stage = line.partition(":")[0]
        if stage in STAGES:
            self.progress = (STAGES.index(stage) + 0.5) / len(STAGES)
        if line and not line.startswith("make"):
            self.said = line
            self.told()

    def _ended(self, status: int, last: str, seconds: float, picture: bytes | None) -> None:
        self.running, self.seconds = False, seconds
        self.finished = status == 0
        if self.stopped:
            self.error = "stopped"
        elif status:
            self.error = last.removeprefix("error: ") or f"make ended with status {status}"
        else:
            self.picture, self.progress = picture, 1.0
            self.count += 1
        self.told()

    def _result(self) -> bytes | None:
        image = cv2.imread(str(self.build.foggy(".png")), cv2.IMREAD_COLOR)
        if image is None:
            return None
        scale = min(1.0, LONGEST / max(image.shape[:2]))
        if scale < 1:
            image = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        return cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 92])[1].tobytes()
