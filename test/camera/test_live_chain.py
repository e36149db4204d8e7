"""The live chain on real pixels: camera, detector and tracker as processes, from a video file."""

import signal
import sys
import time

import numpy as np
import pytest

pytest.importorskip("rclpy")
pytest.importorskip("mediapipe", reason="the detector needs mediapipe")

from live import ROOT, NodeProcess, Peer, stamp_of  # noqa: E402

from benchmarks.common.report import data_folder  # noqa: E402
from lassokin_ros.pipeline.outputs import topics  # noqa: E402
from lassokin_ros.video.sources import open_source  # noqa: E402

VIDEO = data_folder() / "video" / "balancing_cam01.mp4"
FRAMES_NEEDED = 8
FPS, SIZE = 15.0, (540, 960)


def process(module, *parameters):
    arguments = [part for parameter in parameters for part in ("-p", parameter)]
    return NodeProcess("/chain", *arguments, command=[sys.executable, "-m", module])


@pytest.fixture
def slow_video(tmp_path):
    """The video, smaller and at a quarter of its rate, so that a busy machine keeps up."""
    cv2 = pytest.importorskip("cv2")
    file = tmp_path / "slow.avi"
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter.fourcc(*"MJPG"), FPS, SIZE)
    for image in open_source(str(VIDEO)).images:
        writer.write(cv2.cvtColor(cv2.resize(image.rgb, SIZE), cv2.COLOR_RGB2BGR))
    writer.release()
    return file


@pytest.mark.skipif(not VIDEO.is_file(), reason=f"there is no video '{VIDEO}'")
def test_a_video_gives_joints_with_the_stamps_of_its_images(slow_video):
    config = ROOT / "config" / "mediapipe.yaml"
    tracker = NodeProcess("/chain", "--params-file", str(config), "-p", "height:=1.72")
    detector = process("lassokin_ros.detector.command")
    with tracker, detector, Peer("/chain") as peer:
        peer.spin_until(lambda: peer.node.count_publishers("keypoints") > 1, what="the detector")
        with process("lassokin_ros.camera.command", f"source:={slow_video}") as camera:
            joints = peer.got[topics.JOINTS]
            peer.spin_until(lambda: len(joints) >= FRAMES_NEEDED, what="joints")
            now_ns = time.time_ns()
            camera_code, camera_said = camera.stop(signal.SIGINT)
        codes = [detector.stop(signal.SIGINT), tracker.stop(signal.SIGINT)]
    assert camera_code == 0 and "a field of view of 60 degrees is assumed" in camera_said
    assert [code for code, _ in codes] == [0, 0], codes
    stamps = np.array([stamp_of(message) for message in joints])
    assert (np.diff(stamps) > 0).all() and 0 < now_ns - stamps[-1] < 5e9
    steps = np.diff(stamps) / 1e9 * FPS
    assert np.allclose(steps, np.round(steps), atol=0.05), steps
    pelvis = np.array([message.poses[0].position.z for message in joints])
    assert {message.header.frame_id for message in joints} == {"camera_optical_frame"}
    assert (pelvis > 1).all() and (pelvis < 12).all(), pelvis
