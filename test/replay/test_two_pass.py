"""replay --two-pass: the lengths learned over the whole recording are used from its first frame on."""

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="rosbags reads the recordings")

from recordings import RATE, START_NS, contents, read, write_recording  # noqa: E402

from lassokin_ros.cli.replay import main  # noqa: E402
from lassokin_ros.core.body.kinematics import Kinematics  # noqa: E402
from lassokin_ros.core.body.landmarks import Layout  # noqa: E402
from lassokin_ros.core.body.skeleton import Skeleton  # noqa: E402
from lassokin_ros.demo.synthetic import WEBCAM, detections, exact_pixels, motion  # noqa: E402
from lassokin_ros.replay.first_pass import WHOLE_FILE  # noqa: E402
from lassokin_ros.replay.keypoint_recording import write_keypoint_recording  # noqa: E402

FRAMES = 240


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """A person with long arms and short shanks."""
    skeleton = Skeleton.load("anthropometric", 1.75)
    scales = np.ones(skeleton.joint_count)
    for joint, factor in (("elbow", 1.2), ("wrist", 1.2), ("ankle", 0.85), ("knee", 1.12)):
        scales[[skeleton.index(f"{side}_{joint}") for side in ("left", "right")]] = factor
    own = skeleton.with_bone_scales(scales)
    kinematics = Kinematics(own, Layout.load("coco17", own))
    times = np.arange(FRAMES) / RATE
    states = motion(own, times)
    pixels, confidence = detections(exact_pixels(kinematics, states), RATE, 0)
    path = tmp_path_factory.mktemp("two_pass") / "walk"
    stamps = START_NS + np.round(times * 1e9).astype(np.int64)
    write_keypoint_recording(path, stamps, pixels, confidence, WEBCAM.K, WEBCAM.D, WEBCAM.size)
    return path, kinematics.pose(states).positions


def arms(path):
    """(f,) m: length of the left upper arm in the joints of an output."""
    joints = [
        [(p.position.x, p.position.y, p.position.z) for p in message.poses]
        for _, message in read(path, "/tracker/joints")
    ]
    joints = np.array(joints)
    skeleton = Skeleton.load("anthropometric", 1.75)
    ends = [skeleton.index(f"left_{joint}") for joint in ("shoulder", "elbow")]
    return np.linalg.norm(joints[:, ends[1]] - joints[:, ends[0]], axis=-1), joints


def test_the_first_frame_has_the_lengths_learned_by_the_last_frame(recording, tmp_path):
    bag, truth = recording
    for name, options in (("one", []), ("two", ["--two-pass"]), ("again", ["--two-pass"])):
        assert main([str(bag), "-o", str(tmp_path / name), *options]) == 0
    (one, _), (two, joints) = arms(tmp_path / "one"), arms(tmp_path / "two")
    true = np.linalg.norm(np.diff(truth[0, [16, 18]], axis=0))
    assert abs(two[0] - one[-1]) < 0.002 and abs(two[0] - true) < 0.75 * abs(one[0] - true)
    assert len(joints) == FRAMES
    assert contents(tmp_path / "two") == contents(tmp_path / "again")


@pytest.mark.parametrize(
    ("setting", "words"), [("max_people:=3", "is for one person"), ("calibrate:=false", "needs calibration")]
)
def test_contradictory_settings_are_refused(recording, tmp_path, capsys, setting, words):
    assert main([str(recording[0]), "-o", str(tmp_path / "out"), "--two-pass", "-p", setting]) == 2
    assert words in capsys.readouterr().err and not (tmp_path / "out").exists()


def test_a_recording_too_short_for_calibration_is_tracked(tmp_path):
    bag = write_recording(tmp_path / "short", 20)
    smoothed = [word for name, value in WHOLE_FILE.items() for word in ("-p", f"{name}:={value}")]
    assert main([str(bag), "-o", str(tmp_path / "one"), *smoothed]) == 0
    assert main([str(bag), "-o", str(tmp_path / "two"), "--two-pass"]) == 0
    assert np.array_equal(arms(tmp_path / "one")[1], arms(tmp_path / "two")[1])
