"""Chromium for tests and benchmarks of pages; whoever imports this is left out where there is no Playwright."""

from __future__ import annotations

import os
import shutil
from contextlib import contextmanager

import pytest

sync_api = pytest.importorskip("playwright.sync_api", reason="no Playwright: make test-browser installs it and runs these tests")
CHROMIUM = shutil.which(os.environ.get("CHROMIUM", "chromium")) or shutil.which("google-chrome")
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium: make test-browser installs it and runs these tests")


@contextmanager
def chromium():
    with sync_api.sync_playwright() as playwright:
        # as root, and in small containers
        opened = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--disable-dev-shm-usage"])
        yield opened
        opened.close()


@pytest.fixture(scope="module")
def browser():
    with chromium() as opened:
        yield opened
