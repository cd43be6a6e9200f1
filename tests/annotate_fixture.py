"""A scene on a desk without a browser, and a preview that computes nothing."""

from __future__ import annotations

import shutil
import threading
from pathlib import Path
from queue import Empty, Queue

import numpy as np

PROJECT = Path(__file__).parents[1]


def scenes_with(root: Path, *names: str) -> Path:
    """A folder of scenes of its own, with copies of the project's."""
    scenes = root / "scenes"
    scenes.mkdir()
    for name in names:
        (scenes / name).mkdir()
        for file in (PROJECT / "scenes" / name).iterdir():
            if file.is_file() and file.suffix in (".yaml", ".jpg", ".png"):
                shutil.copy(file, scenes / name)
    return scenes


class StillPreview:
    """Grey fog, at once; what it was asked for is kept."""

    def __init__(self, scenes, name, folder):
        self.asked, self.cancelled, self.closed = [], 0, False

    def geometry(self, data):
        return None, []

    def estimate(self, data, rough=lambda: None):
        self.asked.append(data)
        return []

    def foggy(self, fog=None, gains=None, quickly=False):
        self.asked.append((fog, gains))
        return np.full((6, 8, 3), 128, np.uint8)

    def cancel(self):
        self.cancelled += 1

    def close(self):
        self.closed = True


class Loop:
    """The server's thread, whose turns a test takes by hand."""

    def __init__(self):
        self.calls, self.delayed, self.thread = Queue(), [], threading.current_thread()

    def add_callback(self, call):
        self.calls.put(call)

    def call_later(self, seconds, call):
        self.delayed.append(call)

    def turn(self, delayed: bool = False) -> None:
        """Does what waits, and, where asked, what waits for time to pass."""
        while delayed and self.delayed:
            self.delayed.pop(0)()
        while True:
            try:
                self.calls.get(timeout=0.05)()
            except Empty:
                return
