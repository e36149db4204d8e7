"""The data in a page of the report, and a real headless Chromium that shows it."""

import base64
import json
import re
import shutil
from contextlib import contextmanager

import numpy as np
import pytest

from lassokin_ros.replay.report.page_json import MISSING

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FLAGS = (
    "--no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync"
).split()

DEADLINE_MS = 180_000
"""After this time a condition counts as never met: a busy machine may need a minute to draw a scene without a GPU."""


def held(page, name="data"):
    """The data for the page's scripts. page: its text."""
    return json.loads(re.search(rf'<script type="application/json" id="{name}">(.*?)</script>', page).group(1))


def unpacked(packed):
    """The array in `page_json.packed`."""
    counts = np.frombuffer(base64.b64decode(packed["data"]), "<i2").reshape(packed["shape"])
    return np.where(counts == MISSING, np.nan, counts * packed["step"])


@contextmanager
def browser():
    """The browser of playwright; skips if it is not available."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright drives the browser")
    program = next(filter(None, map(shutil.which, NAMES)), None)
    if program is None:
        pytest.skip("there is no Chromium on this machine: apt install chromium")
    with playwright.sync_playwright() as driver:
        running = driver.chromium.launch(executable_path=program, args=FLAGS)
        try:
            yield running
        finally:
            running.close()


class Page:
    """An opened file; `errors` are those of its scripts and what the console warns of, `requests` what it requested.

    clock: whether `page.clock` alone advances the time of its scripts, after it was drawn.
    """

    def __init__(self, running, path, hash="", clock=False):
        self.errors, self.requests = [], []
        self.page = running.new_page(viewport={"width": 1280, "height": 900})
        self.page.set_default_timeout(DEADLINE_MS)
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("console", self._heard)
        self.page.on("request", lambda request: self.requests.append(request.url))
        if clock:
            self.page.clock.install()
        self.page.goto(f"file://{path}{hash}")
        self.page.wait_for_selector("body[data-drawn], body[data-error]", state="attached")
        if clock:
            self.page.clock.pause_at(self.value("Date.now() + 100"))

    def _heard(self, message):
        if message.type in ("error", "warning") and "GL Driver Message" not in message.text:  # of the driver
            self.errors.append(message.text)

    def value(self, script):
        """The value of a script in the page."""
        return self.page.evaluate(script)

    def comes(self, script, milliseconds):
        """Whether a script returns true within a time."""
        try:
            self.page.wait_for_function(script, timeout=milliseconds)
        except Exception:
            return False
        return True

    def reach(self, script, what):
        """Wait until a script returns true."""
        try:
            self.page.wait_for_function(script)
        except Exception as error:
            raise AssertionError(f"{what} did not come: {error}") from None
