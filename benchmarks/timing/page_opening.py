"""Time until the page of `replay --report` is drawn in headless Chromium, for a recording of a given length.

python -m benchmarks.timing.page_opening [--seconds 60] [--times 5]
"""

from __future__ import annotations

import argparse
import shutil
import statistics
import sys
import tempfile
import time
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

from benchmarks.same_output import write_recording
from lassokin_ros.cli.replay import main as replay

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FLAGS = ["--no-sandbox", "--disable-gpu"]


def main() -> int:
    """Print the page's size and the median, least and largest time."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seconds", type=float, default=60.0, help="length of the recording (60)")
    parser.add_argument("--times", type=int, default=5, help="how often the page is opened (5)")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        recording, page = Path(folder) / "recording", Path(folder) / "page.html"
        write_recording(recording, 1, options.seconds)
        files = ["--output", f"{folder}/out", "--storage", "sqlite3", "--report", str(page)]
        with redirect_stdout(StringIO()):
            replay([str(recording), *files, "-p", "height:=1.75"])
        taken = opening_times(page, options.times)
        print(
            f"{options.seconds:g} s of keypoints, {page.stat().st_size / 1e6:.1f} MB: drawn after "
            f"{statistics.median(taken):.2f} s ({min(taken):.2f} to {max(taken):.2f})"
        )
    return 0


def opening_times(page: Path, times: int) -> list[float]:
    """s from the request until everything is drawn, each in a new tab."""
    from playwright.sync_api import sync_playwright

    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    if program is None:
        raise SystemExit("there is no Chromium on this machine: apt install chromium")
    taken = []
    with sync_playwright() as driver:
        running = driver.chromium.launch(executable_path=program, args=FLAGS)
        for _ in range(times):
            tab = running.new_page(viewport={"width": 1280, "height": 900})
            begin = time.monotonic()
            tab.goto(page.as_uri())
            tab.wait_for_selector("body[data-drawn]", state="attached")
            taken.append(time.monotonic() - begin)
            tab.close()
        running.close()
    return taken


if __name__ == "__main__":
    sys.exit(main())
