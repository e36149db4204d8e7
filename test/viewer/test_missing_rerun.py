"""The node `viewer` without rerun-sdk."""

import sys

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("cv2")

from lassokin_ros.video.rerun_scene import ViewError  # noqa: E402
from lassokin_ros.viewer.node import ViewerNode  # noqa: E402


@pytest.mark.parametrize("save, words", [(None, "the viewer"), ("walk.rrd", "viewer --save")])
def test_a_missing_rerun_is_named_with_what_needs_it(save, words, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(ViewError) as error:
        ViewerNode(save and tmp_path / save, False)
    assert str(error.value) == f"{words} needs rerun-sdk; install it with: pip install '.[view]'"
