"""`replay` reads depth images, plain and compressed, from both storages."""

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="rosbags reads and writes recordings")

from depth_camera import compressed_message, depth_message, render  # noqa: E402
from messages import FOCAL, HEIGHT, WIDTH, camera_info, cloud  # noqa: E402
from recordings import START_NS, read, write_messages  # noqa: E402

from lassokin_ros.cli.replay import main  # noqa: E402
from lassokin_ros.core.body.kinematics import Kinematics  # noqa: E402
from lassokin_ros.core.body.landmarks import Layout  # noqa: E402
from lassokin_ros.core.body.skeleton import Skeleton  # noqa: E402
from lassokin_ros.core.image.projection import project  # noqa: E402
from lassokin_ros.demo.synthetic import motion  # noqa: E402
from lassokin_ros.replay.bags import typestore  # noqa: E402
from msg_adapters.backends import RosbagsBackend  # noqa: E402

FRAMES, PERIOD_NS, HEIGHT_M = 30, 33_333_333, 1.9
PLAIN, COMPRESSED = "/depth/image", "/depth/image/compressedDepth"
PLAIN_TYPE, COMPRESSED_TYPE = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"


def messages(late_ns=20_000_000):
    """Keypoints, camera_info and depth images, plain and as RVL, of a person of HEIGHT_M.

    Each image comes `late_ns` after its keypoints; keypoints wait for theirs from the first image on.
    """
    skeleton, backend = Skeleton.load("anthropometric", HEIGHT_M), RosbagsBackend(typestore())
    kinematics = Kinematics(skeleton, Layout.load("coco17", skeleton))
    states = motion(skeleton, 1.0 + np.arange(FRAMES) / 30)
    pose = kinematics.pose(states)
    for number, pixels in enumerate(project(pose.landmarks) * FOCAL + [WIDTH / 2, HEIGHT / 2]):
        stamp_ns = START_NS + number * PERIOD_NS
        depth = render(skeleton, pose.positions[number], 0.25)
        yield "/camera_info", "sensor_msgs/msg/CameraInfo", stamp_ns, camera_info(backend)
        yield "/keypoints", "sensor_msgs/msg/PointCloud2", stamp_ns, cloud(backend, stamp_ns, pixels)
        yield PLAIN, PLAIN_TYPE, stamp_ns + late_ns, depth_message(backend, stamp_ns, depth)
        packed = compressed_message(backend, stamp_ns, depth, codec="rvl")
        yield COMPRESSED, COMPRESSED_TYPE, stamp_ns + late_ns, packed


def tracked(recording, output, *more):
    """(f,) m: the distance of the person in each frame."""
    assert main([str(recording), "--output", str(output), "-p", "height:=1.6", *more]) == 0
    return np.array([message.point.z for _, message in read(output, "/tracker/translation")])


def test_compressed_depth_images_give_what_plain_ones_give(tmp_path, capsys):
    recording = write_messages(tmp_path / "walk", list(messages()), "sqlite3")
    without = tracked(recording, tmp_path / "without")
    plain = tracked(recording, tmp_path / "plain", "-p", f"depth:={PLAIN}")
    assert f"for {FRAMES - 1} of {FRAMES} keypoint messages" in capsys.readouterr().out
    compressed = tracked(recording, tmp_path / "compressed", "-p", f"depth:={COMPRESSED}")
    assert f"for {FRAMES - 1} of {FRAMES} keypoint messages" in capsys.readouterr().out
    assert np.array_equal(plain, compressed) and len(plain) == FRAMES
    assert np.abs(plain - without).mean() > 0.1  # the height is wrong, and the depth corrects the distance


def test_a_recording_waits_for_late_images_for_100_ms_also_with_a_shorter_wait(tmp_path, capsys):
    """The keypoints of the next two frames come before the image."""
    late = sorted(messages(70_000_000), key=lambda message: message[2])
    recording = write_messages(tmp_path / "late", [message for message in late if message[0] != COMPRESSED])
    tracked(recording, tmp_path / "out", "-p", f"depth:={PLAIN}", "-p", "wait:=0.01")
    said = capsys.readouterr().out
    assert f"for {FRAMES - 3} of {FRAMES} keypoint messages" in said and "image before" not in said
