"""Replay of a recording with two cameras: poses from TF or from a calibration file."""

import numpy as np
import pytest
from camera_rig import MAP, eye, keypoints, pixels, tf_of, truth_at
from messages import FOCAL, HEIGHT, WIDTH, camera_info, rosbags_backend
from recordings import read, write_messages
from scipy.spatial.transform import Rotation

from lassokin_ros.cli.replay import main

pytest.importorskip("rosbags")
BACKEND, START_NS, FRAMES = rosbags_backend(), 1_700_000_000_000_000_000, 60
EYES = [eye("left", 0), eye("right", 90)]
TRUTH = truth_at(np.arange(FRAMES) / 30)
INFO, CLOUD, TF = "sensor_msgs/msg/CameraInfo", "sensor_msgs/msg/PointCloud2", "tf2_msgs/msg/TFMessage"
CAMERAS = ("-p", "cameras:=[left, right]", "-p", f"fixed_frame:={MAP}")


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    messages, random = [], np.random.default_rng(0)
    for one in EYES:
        messages.append(("/tf_static", TF, START_NS, tf_of(BACKEND, one, START_NS, 0.0)))
        messages.append((f"/robot/{one.name}/camera_info", INFO, START_NS, camera_info(BACKEND, frame_id=one.frame)))
    for index in range(FRAMES):
        for number, one in enumerate(EYES):
            message = keypoints(BACKEND, one, START_NS, index / 30, TRUTH.landmarks[index], random)
            time_ns = START_NS + round(1e9 * index / 30) + (20 + number) * 1_000_000
            messages.append((f"/robot/{one.name}/keypoints", CLOUD, time_ns, message))
    return write_messages(tmp_path_factory.mktemp("rig") / "bag", messages)


def joints(output):
    """Frame ids, and the error of each frame's joints, m."""
    frames, errors = set(), []
    for _, message in read(output, "/tracker/joints"):
        stamp_ns = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        places = np.array([[p.position.x, p.position.y, p.position.z] for p in message.poses])
        truth = TRUTH.positions[round((stamp_ns - START_NS) * 1e-9 * 30)]
        frames.add(message.header.frame_id)
        errors.append(np.linalg.norm(places - truth, axis=1).mean())
    return frames, np.array(errors)


def test_two_cameras_with_tf(bag, tmp_path, capsys):
    output = tmp_path / "out"
    assert main([str(bag), "-o", str(output), *CAMERAS, "--export", ".npz"]) == 0
    frames, errors = joints(output)
    assert frames == {MAP} and len(errors) == FRAMES and np.median(errors[15:]) < 0.02
    said = capsys.readouterr().out
    assert "/robot/right/keypoints" in said and "follow TF in the frame 'map'" in said
    motion = np.load(output / "motion.npz")
    assert motion["joint_positions"].shape == (FRAMES, 24, 3)
    assert motion["camera_names"].tolist() == ["left", "right"]
    assert np.array_equal(motion["detected_px"], motion["detected_px_left"], equal_nan=True)
    frames = np.round((motion["stamp_ns"] - motion["stamp_ns"][0]) * 30e-9).astype(int)
    for one in EYES:
        detected, reprojected = motion[f"detected_px_{one.name}"], motion[f"reprojected_px_{one.name}"]
        true = np.array([pixels(one, 0, TRUTH.landmarks[i], np.random.default_rng(0), 0.0) for i in frames])
        seen = np.isfinite(detected[..., 0]).all(axis=1)
        assert seen.sum() >= FRAMES - 2 and np.array_equal(seen, np.isfinite(reprojected[..., 0]).all(axis=1))
        assert np.abs(detected[seen] - true[seen]).mean() < 1.2  # noise of 1 px
        assert np.abs(reprojected[seen] - true[seen])[15:].mean() < 5


def test_a_calibration_file_gives_lenses_and_poses(bag, tmp_path):
    lines = []
    for one in EYES:
        pose = one.pose_at(0)
        rotation = Rotation.from_matrix(pose.rotation).as_rotvec().tolist()
        lines += [f"[{one.name}]", f'name = "{one.name}"', f"size = [{WIDTH}.0, {HEIGHT}.0]",
                  f"matrix = [[{FOCAL}, 0.0, {WIDTH / 2}], [0.0, {FOCAL}, {HEIGHT / 2}], [0.0, 0.0, 1.0]]",
                  "distortions = [0.0, 0.0, 0.0, 0.0]", f"rotation = {rotation}",
                  f"translation = {pose.translation.tolist()}", "fisheye = false"]  # fmt: skip
    calibration = tmp_path / "calib.toml"
    calibration.write_text("\n".join(lines) + "\n")
    assert main([str(bag), "-o", str(tmp_path / "out"), *CAMERAS, "--camera-info", str(calibration)]) == 0
    frames, errors = joints(tmp_path / "out")
    assert frames == {MAP} and np.median(errors[15:]) < 0.02


@pytest.mark.parametrize("place, code", [("", 0), ("/robot", 2)])
def test_a_topic_without_a_namespace_comes_before_those_in_one(place, code, tmp_path, capsys):
    messages, random = [], np.random.default_rng(0)
    for index in range(15):
        for number, one in enumerate(EYES):
            time_ns = START_NS + round(1e9 * index / 30) + number
            seen = keypoints(BACKEND, one, START_NS, index / 30, TRUTH.landmarks[index], random)
            info = camera_info(BACKEND, frame_id=one.frame)
            for space in ("/debug", place):
                messages.append((f"{space}/{one.name}/camera_info", INFO, time_ns, info))
            messages.append((f"{place}/{one.name}/keypoints", CLOUD, time_ns, seen))
            messages.append((f"/debug/{one.name}/keypoints", CLOUD, time_ns, seen))
    tf = [("/tf_static", TF, START_NS, tf_of(BACKEND, one, START_NS, 0.0)) for one in EYES]
    bag = write_messages(tmp_path / "bag", [*tf, *messages])
    assert main([str(bag), "-o", str(tmp_path / "out"), *CAMERAS]) == code
    said = capsys.readouterr()
    if code:
        assert "several topics 'left/keypoints': " in said.err and "/debug/left/keypoints" in said.err
    else:
        assert "/left/keypoints" in said.out and "/debug" not in said.out


@pytest.mark.parametrize(
    "options, words",
    [
        (("-p", "cameras:=[left, front]"), "front/keypoints"),
        ((*CAMERAS, "--keypoints-topic", "/robot/left/keypoints"), "with several cameras"),
    ],
)
def test_topics_that_are_not_there_are_named(bag, tmp_path, capsys, options, words):
    assert main([str(bag), "-o", str(tmp_path / "out"), *options]) != 0
    assert words in capsys.readouterr().err
