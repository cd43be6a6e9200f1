"""A person before the annotation page: a server as `make annotate` starts it, and a browser's mouse and keys.

Needs Playwright, Chromium and Bokeh; used by tests/test_annotate_browser.py and tests/benchmarks/annotate.py.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

from ruamel.yaml import YAML

PROJECT = Path(__file__).parents[1]
DESKTOP, NARROW = {"width": 1440, "height": 900}, {"width": 420, "height": 860}
#: Seconds for what takes a moment on a free machine and long on a busy one.
PATIENCE = 60


class Served:
    """`python -m pipeline annotate` in a process of its own. `address` is the page's."""

    def __init__(self, scenes: Path, builds: Path, scene: str, photo: Path | None = None):
        self.scenes, self.builds, self.scene = scenes, builds, scene
        command = [sys.executable, "-m", "pipeline", "annotate", "--scene", scene, "--scenes", str(scenes), "--build", str(builds),
                   "--no-browser", *(["--photo", str(photo)] if photo is not None else [])]
        environment = {key: value for key, value in os.environ.items() if not key.startswith("FOG_")}
        self.process = subprocess.Popen(command, cwd=PROJECT, env=environment, stdout=subprocess.PIPE, text=True)
        for line in self.process.stdout:
            found = re.search(r"http://127\.0\.0\.1:\d+/\S+/", line)
            if found:
                self.address = found[0]
                return
        raise AssertionError("the server did not start")

    @property
    def path(self) -> Path:
        return self.scenes / self.scene / "scene.yaml"

    def data(self) -> dict:
        return YAML(typ="safe").load(self.path.read_text(encoding="utf-8"))

    def kill(self) -> None:
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()

    def end(self) -> None:
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
            self.process.wait(30)
        self.process.stdout.close()


class Person:
    """Mouse and keys; nothing may go wrong on the page, and nothing may be fetched from elsewhere."""

    def __init__(self, browser, served: Served, **options):
        self.served, self.faults, self.fetched = served, [], []
        self.context = browser.new_context(**{"viewport": DESKTOP, **options})
        self.page = self.context.new_page()
        self.page.on("pageerror", lambda error: self.faults.append(str(error)))
        self.page.on("console", lambda message: message.type == "error" and "favicon" not in message.location.get("url", "")
                     and self.faults.append(message.text))
        self.page.on("request", lambda request: self.fetched.append(request.url))

    def come(self) -> Person:
        self.page.goto(self.served.address)
        self.until("() => !!(window.annotate && window.annotate.ready)")
        return self

    def until(self, condition, seconds: float = PATIENCE) -> None:
        """Until a script says so, or a function of ours."""
        end = time.monotonic() + seconds
        while not (condition() if callable(condition) else self.page.evaluate(condition)):
            assert time.monotonic() < end, f"in {seconds} s not: {condition}; {self.said()}"
            self.page.wait_for_timeout(20)

    def said(self) -> str:
        return " | ".join(self.page.inner_text(f"#{name}") for name in ("status", "banner", "hint", "problems"))

    def where(self, x: float, y: float) -> tuple[float, float]:
        return tuple(self.page.evaluate(f"window.annotate.where({x}, {y})"))

    def click(self, *points) -> None:
        for x, y in points:
            self.page.mouse.click(*self.where(x, y))

    def drag(self, start, end) -> None:
        self.page.mouse.move(*self.where(*start))
        self.page.mouse.down()
        self.page.mouse.move(*self.where(*end), steps=4)
        self.page.mouse.up()

    def keys(self, *keys: str) -> None:
        for key in keys:
            self.page.keyboard.press(key)

    def add(self, kind: str, *, by: str = "") -> None:
        """Begins to draw, by the key or by the button."""
        if by:
            self.keys(by)
        else:
            self.page.click(f'[data-do="add"][data-kind="{kind}"]')
        self.until(f"() => document.querySelector('[data-kind=\"{kind}\"]').classList.contains('on') || "
                   "document.querySelector('.corners .on') !== null")

    def option(self, name: str, value: str) -> None:
        self.page.select_option(f"#opt-{name}", value)

    def outline(self, kind: str, points, plane: str = "", by: str = "") -> None:
        self.add(kind, by=by)
        if plane:
            self.option("plane", plane)
        self.click(*points)
        self.keys("Enter")
        self.until("() => document.querySelector('#add .on[data-do=add]') === null")

    def field(self, label: str, value: str) -> None:
        """Types a value into the field of that name among the chosen thing's."""
        found = self.page.locator("#chosen .field", has=self.page.locator("label", has_text=re.compile(rf"^{re.escape(label)}\b")))
        found.first.wait_for(timeout=PATIENCE * 1000)
        control = found.first.locator("input, select")
        if control.evaluate("one => one.tagName") == "SELECT":
            control.select_option(value)
        else:
            control.fill(value)
            control.press("Enter")
            self.until("() => document.activeElement.id === 'stage'")

    def choose(self, text: str) -> None:
        """By its name in the list."""
        button = self.page.locator("#things button", has_text=re.compile(rf"^\s*{re.escape(text)}")).first
        button.click()
        self.until(lambda: "on" in (button.get_attribute("class") or "").split())

    def saved(self, condition) -> dict:
        """The scene file, once it holds what is expected."""
        def holds() -> bool:
            try:
                return bool(condition(self.served.data()))
            except (KeyError, TypeError, IndexError):
                return False
        self.until(holds)
        return self.served.data()

    def leave(self) -> None:
        foreign = [url for url in self.fetched if not url.startswith((self.served.address, "data:", "blob:"))
                   and not url.endswith("/favicon.ico")]
        self.context.close()
        assert not self.faults and not foreign, (self.faults, foreign)
