"""Every `lassokin track` of the pages for a new user runs as written, and writes the files that it names.

A small video takes the place of the sources, and detectors of known output that of MediaPipe and of model files;
test_first_skeleton.py runs some of them with MediaPipe. The window of --view is not opened.
"""

import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from lassokin_ros.detector.backend import Detected
from lassokin_ros.video import track
from lassokin_ros.video.command import main

cv2 = pytest.importorskip("cv2")

ROOT = Path(__file__).resolve().parents[2]
PAGES = ("README.md", "docs/first-skeleton.md", "docs/files.md", "docs/gait.md", "docs/questions.md")
COMMAND = r"(?:^ *|`)(lassokin {} [^`\n]+)"
FRAMES, SIZE = 12, (320, 240)
STANDING = np.array(
    [[0, -80], [4, -84], [-4, -84], [9, -82], [-9, -82], [20, -60], [-20, -60], [26, -30], [-26, -30], [28, 0],
     [-28, 0], [11, 0], [-11, 0], [12, 45], [-12, 45], [12, 88], [-12, 88]], float
)  # fmt: skip


def commands(name):
    """The words of every command with this name, each once."""
    text = "\n".join((ROOT / page).read_text(encoding="utf-8") for page in PAGES)
    found = [shlex.split(line, comments=True)[2:] for line in re.findall(COMMAND.format(name), text, re.MULTILINE)]
    whole = [tuple(words) for words in found if not words[0].startswith("-")]
    assert whole, f"the pages have no lassokin {name}"
    return list(dict.fromkeys(whole))


class Standing:
    """One person; with a model file two."""

    landmarks = "coco17"

    def __init__(self, name):
        self.several = name.endswith(".onnx")

    def detect(self, image, seconds):
        return [Detected(STANDING + (x, 120), np.full(17, 0.9)) for x in (100, 220)[: 1 + self.several]]

    def close(self):
        pass


@pytest.mark.parametrize("words", commands("track"), ids=" ".join)
def test_a_track_command_runs_and_writes_its_files(words, tmp_path, monkeypatch, capsys):
    if "--cameras" in words:
        pytest.skip("test/video/test_several_videos.py runs several videos")
    if "--view" in words:
        pytest.importorskip("rerun", reason="--view needs rerun-sdk")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(track, "make_detector", Standing)
    writer = cv2.VideoWriter("source.mp4", cv2.VideoWriter_fourcc(*"mp4v"), 30.0, SIZE)
    for number in range(FRAMES):
        writer.write(np.full((*SIZE[::-1], 3), 20 * number, np.uint8))
    writer.release()
    window = words[-1] == "--view"
    given = ["source.mp4", *words[1:]]
    assert main(given[:-1] if window else given) == 0
    assert f"{FRAMES} in, {FRAMES} tracked" in capsys.readouterr().out
    named = [word for option, word in zip(words, words[1:]) if option in ("--report", "--video", "--export", "--view")]
    if "all" in words:  # a file for each person
        named = [name for name in named if not name.endswith(".bvh")] + ["street_p1.bvh", "street_p2.bvh"]
    assert {file.name for file in tmp_path.iterdir()} == {"source.mp4", *named}
    assert all((tmp_path / name).stat().st_size > 500 for name in named)


def test_every_measure_command_is_one_that_test_docs_runs():
    """There it reads a recording of a person who walks or squats."""
    page = (ROOT / "docs" / "gait.md").read_text(encoding="utf-8")
    for words in commands("measure"):
        assert f"\nlassokin measure {' '.join(words).replace('walk.mp4 --height 1.72', 'strides.npz')}\n" in page
