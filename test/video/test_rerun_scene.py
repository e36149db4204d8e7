"""--view: the content of a recording for Rerun, and one line for each error."""

import sys
from pathlib import Path

import pytest

pytest.importorskip("cv2")

from lassokin_ros.video.command import WINDOW, main, parser  # noqa: E402
from lassokin_ros.video.rerun_scene import RerunScene, ViewError  # noqa: E402


def test_a_recording_contains_image_skeleton_uncertainty_and_angles(images, tmp_path, capsys):
    pytest.importorskip("rerun", reason="--view needs rerun-sdk")
    file = tmp_path / "walk.rrd"
    assert main([str(images), "--height", "1.8", "--view", str(file)]) == 0
    assert "walk.rrd" in capsys.readouterr().out and [f.name for f in tmp_path.glob("*.rrd")] == ["walk.rrd"]
    assert main([str(images), "--view", str(file)]) == 2
    assert "exists already" in capsys.readouterr().err
    reader = pytest.importorskip("rerun.chunk", reason="this rerun-sdk cannot read recordings").RrdReader
    entities = {}
    for chunk in reader(file).stream().to_chunks():
        entities[chunk.entity_path] = entities.get(chunk.entity_path, 0) + (0 if chunk.is_static else chunk.num_rows)
    for path in ("/camera/image", "/camera/image/keypoints", "/camera/image/skeleton", "/body/skeleton"):
        assert entities[path] == 6, entities
    for path in ("/body/uncertainty", "/angles/left_knee", "/errors/reprojection", "/errors/uncertainty"):
        assert entities[path] == 6, entities


def test_a_missing_rerun_is_named_with_its_installation(images, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "rerun", None)
    assert main([str(images), "--view", str(tmp_path / "walk.rrd")]) == 2
    assert (
        capsys.readouterr()
        .err.splitlines()[-1]
        .endswith("--view needs rerun-sdk; install it with: pip install '.[view]'")
    )
    assert not list(tmp_path.glob("*.rrd"))


def test_the_option_without_a_file_opens_a_window():
    assert parser().parse_args(["0"]).view is None
    assert parser().parse_args(["0", "--view"]).view == WINDOW
    assert parser().parse_args(["0", "--view", "w.rrd"]).view == Path("w.rrd")


def test_a_recording_that_cannot_be_flushed_is_reported(tmp_path):
    """By a stand-in for Rerun's stream on a full disk."""

    class Full:
        def flush(self):
            raise RuntimeError("File-writer thread shut down\nprematurely")

    view = RerunScene.__new__(RerunScene)
    view._stream, view._path = Full(), tmp_path / "a.rrd"
    with pytest.raises(ViewError, match="a.rrd' cannot be written completely: File-writer thread shut"):
        view.finish()
