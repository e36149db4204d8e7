"""A replay solves each lasso with ProxQP."""

import pytest

pytest.importorskip("rosbags", reason="rosbags reads and writes recordings")

from faults.solves import counted_solves  # noqa: E402
from recordings import write_recording  # noqa: E402

from lassokin_ros.cli.replay import main  # noqa: E402

FRAMES = 90


def test_proxqp_solves_every_lasso_of_a_replay_once(tmp_path, monkeypatch):
    recording = write_recording(tmp_path / "walk", FRAMES)
    counts = counted_solves(monkeypatch)
    assert main([str(recording), "-o", str(tmp_path / "out")]) == 0
    assert counts["lassos"] >= FRAMES and counts["nontrivial"] > 0.9 * FRAMES
    assert counts["qp"] == counts["nontrivial"] == counts["by proxqp"], counts
