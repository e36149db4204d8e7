"""benchmarks/video.py: with the same keypoints, the chain from a video is as accurate as the tracker alone."""

import numpy as np
import pytest

pytest.importorskip("cv2")
pytest.importorskip("rosbags", reason="rosbags has the message types")

from benchmarks import video as module  # noqa: E402
from benchmarks.common.report import data_folder  # noqa: E402
from lassokin_ros.detector.backend import Detected  # noqa: E402

NAME = "balancing_cam01"
FILES = data_folder() / "video" / f"{NAME}.mp4", data_folder() / "detections" / "balancing_mediapipe_full.npz"


class Shared:
    """A detector that returns the shared keypoints, in order."""

    landmarks = "mediapipe33"
    several = False

    def __init__(self):
        with np.load(FILES[1]) as data:
            self._keypoints = iter(data["kp2d"][0].astype(float))

    def detect(self, image, seconds):
        points = next(self._keypoints)
        return [Detected(points[:, :2], np.nan_to_num(points[:, 2]))]

    def close(self):
        pass


@pytest.mark.skipif(not all(file.is_file() for file in FILES), reason=f"there is no {FILES[0]} or {FILES[1].name}")
def test_the_chain_is_as_accurate_as_the_tracker_alone(monkeypatch, capsys):
    """The keypoints differ by 0.01 px at most, but that may decide when a hypothesis replaces the state."""
    monkeypatch.setattr(module, "make_detector", lambda name: Shared())
    shared, chain = module.pair(NAME, "mediapipe")
    assert chain["frames"] == shared["frames"] == 100 and chain["apart_px"] < 0.01
    for figure, limit in (("mpjpe_mm", 4.0), ("pa_mpjpe_mm", 4.0), ("reprojection_px", 0.1)):
        assert abs(chain[figure] - shared[figure]) < limit, (figure, chain[figure], shared[figure])
