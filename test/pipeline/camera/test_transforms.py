"""TF: chains of frames, times, and the tracker that uses them."""

from dataclasses import replace

import numpy as np
import pytest
from messages import FOCAL, FRAME, HEIGHT, WIDTH, camera_info, cloud, pixels_of_motion, rosbags_backend
from recordings import read, write_messages
from scipy.spatial.transform import Rotation
from transforms import OPTICAL, rpy, tf_message

from lassokin_ros.cli.replay import main
from lassokin_ros.core.body.kinematics import Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.errors import ConfigurationError
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.learned.vertical import level_from_camera
from lassokin_ros.demo.synthetic import motion
from lassokin_ros.pipeline.camera.transforms import LONGEST_NAME, MOST_FRAMES, MOST_STAMPS, TransformError, Transforms
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import NodeSettings

BACKEND = rosbags_backend()
BASE, SECOND = "base_footprint", 1_000_000_000
DOWN = np.radians(30)
HIGH = 2.73  # m, of the camera above the floor on which the person of PIXELS stands if it looks down by DOWN
SKELETON = Skeleton.load("anthropometric", 1.75)
PIXELS = pixels_of_motion(3)


def roll_and_pitch(rotation):
    """rad, of a camera by the rotation from its optical frame to one with z up."""
    right, down, forward = rotation[2]
    return np.arctan2(-right, -down), np.arctan2(-forward, np.hypot(right, down))


def robot(pitch_now=DOWN, stamp_ns=SECOND, transforms=None, hanging=np.pi):
    """TF of a robot whose neck moves and whose camera hangs upside down on the head (roll `hanging`, rad)."""
    transforms = transforms or Transforms()
    fixed = [(BASE, "base_link", Rotation.identity()), ("head", "camera", rpy(hanging, 0)), ("camera", FRAME, OPTICAL)]
    transforms.add(tf_message(BACKEND, 0, *fixed), static=True)
    transforms.add(tf_message(BACKEND, stamp_ns, ("base_link", "head", rpy(0, pitch_now))), static=False)
    return transforms


def test_a_chain_of_fixed_and_moving_frames():
    transforms = robot()
    expected = rpy(0, DOWN) * rpy(np.pi, 0) * OPTICAL
    assert np.allclose(transforms.pose(FRAME, BASE, SECOND)[0], expected.as_matrix())
    assert np.allclose(transforms.pose(BASE, FRAME, SECOND)[0], expected.inv().as_matrix())
    assert np.allclose(transforms.pose(FRAME, FRAME, SECOND)[0], np.eye(3))


def test_a_nodding_head_is_interpolated_at_the_time_of_the_image():
    transforms = robot(0.2)
    robot(0.4, SECOND + 100_000_000, transforms)
    for ms, pitch in ((-200, 0.2), (0, 0.2), (50, 0.3), (75, 0.35), (100, 0.4)):
        found = roll_and_pitch(transforms.pose("head", BASE, SECOND + ms * 1_000_000)[0] @ OPTICAL.as_matrix())
        assert np.allclose(found, (0, pitch), atol=1e-4)
    for ms in (-201, 301):
        with pytest.raises(TransformError, match="'head' is more than 0.2 s"):
            transforms.pose(FRAME, BASE, SECOND + ms * 1_000_000)


def test_a_jump_is_not_interpolated():
    """No robot has been between: odometry was reset."""
    transforms = robot(0.2)
    robot(1.4, SECOND + 100_000_000, transforms)
    for ms, pitch in ((0, 0.2), (40, 0.2), (60, 1.4), (100, 1.4)):
        found = transforms.pose("head", BASE, SECOND + ms * 1_000_000)[0] @ OPTICAL.as_matrix()
        assert np.allclose(roll_and_pitch(found), (0, pitch), atol=1e-4)


@pytest.mark.parametrize(
    "rad_s, period_s, at_s", [(4.9, 0.1, 0.05), (4.9, 0.1, 0.25), (4.9, 0.01, 0.15), (1e-7, 0.1, 0.2)]
)
def test_a_camera_away_from_the_axis_moves_on_a_circle(rad_s, period_s, at_s):
    """Between the transforms, and beyond the newest one."""
    transforms, arm = Transforms(), np.array([1.0, 0.0, 1.2])
    for seconds in (0.0, period_s):
        link = BASE, "turret", rpy(0, 0, rad_s * seconds)
        transforms.add(tf_message(BACKEND, SECOND + round(1e9 * seconds), link), static=False)
    transforms.add(tf_message(BACKEND, 0, ("turret", "camera", rpy(0, 0), arm)), static=True)
    rotation, centre = transforms.pose("camera", BASE, SECOND + round(1e9 * at_s))
    assert np.allclose(rotation, rpy(0, 0, rad_s * at_s).as_matrix(), atol=1e-9)
    assert np.allclose(centre, rotation @ arm, atol=1e-9)


@pytest.mark.parametrize("period_s", [0.001, 0.04])
def test_the_noise_of_a_fast_publisher_hardly_grows_beyond_the_newest_transform(period_s):
    """0.3 rad/s with 0.1 degrees of noise, 0.1 s beyond. The noise of two transforms 1 ms apart is 10 degrees there."""
    off = []
    for seed in range(20):
        transforms, random = Transforms(), np.random.default_rng(seed)
        for seconds in np.arange(0.0, 0.4, period_s):
            yaw = 0.3 * seconds + np.radians(0.1) * random.normal()
            transforms.add(tf_message(BACKEND, round(1e9 * seconds), (BASE, "head", rpy(0, 0, yaw))), static=False)
        rotation, _ = transforms.pose("head", BASE, round(1e9 * (seconds + 0.1)))
        found = np.arctan2(rotation[1, 0], rotation[0, 0])
        off.append(np.degrees(found - 0.3 * (seconds + 0.1)))
    assert np.std(off) < 1.2


def test_time_that_starts_again():
    transforms = robot(0.2, 100 * SECOND)
    robot(0.4, SECOND, transforms)  # a bag in a loop
    head = transforms.pose("head", BASE, SECOND)[0] @ OPTICAL.as_matrix()
    assert roll_and_pitch(head)[1] == pytest.approx(0.4)
    transforms.clear()
    assert transforms.pose(FRAME, "camera", 0)[0] is not None
    with pytest.raises(TransformError, match="not connected"):
        transforms.pose(FRAME, BASE, SECOND)[0]


def test_what_does_not_connect_is_named():
    transforms = robot()
    transforms.add(tf_message(BACKEND, 0, ("map", "odom", Rotation.identity())), static=True)
    for frame, base, words in (
        (FRAME, "base_footprnt", "no transform of 'base_footprnt'"),
        ("optical", BASE, "no transform of 'optical'"),
        (FRAME, "odom", f"'{FRAME}' and 'odom' are not connected: .* '{BASE}', .* 'map'"),
    ):
        with pytest.raises(TransformError, match=words):
            transforms.pose(frame, base, SECOND)[0]


def test_a_loop_and_invalid_transforms_do_no_harm():
    transforms = robot()
    bad = tf_message(BACKEND, 0, (BASE, "x", rpy(0, 0)), ("", "y", rpy(0, 0)), ("z", "z", rpy(0, 0)))
    bad.transforms[0].transform.rotation.w = float("nan")
    transforms.add(bad, static=True)
    with pytest.raises(TransformError, match="no transform of 'x'"):
        transforms.pose("x", BASE, SECOND)[0]
    transforms.add(tf_message(BACKEND, 0, ("a", "b", rpy(0, 0)), ("b", "a", rpy(0, 0))), static=True)
    with pytest.raises(TransformError, match="not connected"):
        transforms.pose("a", BASE, SECOND)[0]


@pytest.mark.parametrize("metres", [1e9, -1e308, np.inf, np.nan])
def test_a_place_beyond_the_earth_is_left_out(metres):
    transforms = Transforms()
    for place in (metres, 1e7):
        transforms.add(tf_message(BACKEND, 0, ("map", "camera", rpy(0, 0), (0, 0, place))), static=True)
        if place == metres:
            with pytest.raises(TransformError, match="no transform of"):
                transforms.pose("camera", "map", SECOND)
    assert transforms.pose("camera", "map", SECOND)[1].tolist() == [0, 0, 1e7]


def test_only_a_few_seconds_are_kept():
    transforms = Transforms()
    for i in range(1000):
        transforms.add(tf_message(BACKEND, i * 10_000_000, (BASE, "head", rpy(0, i * 1e-3))), static=False)
    assert len(transforms._frames["head"]._stamps) <= 301
    with pytest.raises(TransformError, match="newer than the image"):
        transforms.pose("head", BASE, SECOND)[0]


def lean_error(nods, fixed_frame):
    """Mean angle in degrees between the estimated and the real trunk, seen by a camera with these pitches (n,), rad."""
    kinematics = Kinematics(SKELETON, Layout.load("coco17", SKELETON))
    stamps = SECOND + np.arange(len(nods)) * 66_000_000
    pose = kinematics.pose(motion(SKELETON, stamps * 1e-9))
    without_network = TrackerConfig(height=1.75, depth_prior=False)  # with it, the mount matters less
    session, errors = Session(without_network, NodeSettings(fixed_frame=fixed_frame)), []
    session.set_camera(camera_info(BACKEND))
    for i, (pitch, stamp) in enumerate(zip(nods, stamps.tolist())):
        level = level_from_camera(0.0, pitch)
        pixels = project(pose.landmarks[i] @ level) * FOCAL + [WIDTH / 2, HEIGHT / 2]
        if fixed_frame:
            robot(pitch, stamp, session.placement.transforms, hanging=0.0)
        answer = session.process(cloud(BACKEND, stamp, pixels), 0)
        if answer.rejection == "other_size":  # most of the person is out of view
            continue
        trunk = answer.estimate.pose.orientations[0][:, 1]
        trunk = OPTICAL.inv().apply(trunk) if fixed_frame else level @ trunk
        errors.append(np.arccos(trunk @ pose.orientations[i, 0][:, 1]))
    return np.degrees(np.mean(errors))


def test_a_person_before_a_nodding_head_stays_upright():
    nods = 0.4 * np.sin(2 * np.pi * np.arange(45) / 45)
    with_tf, without = (lean_error(nods, fixed_frame) for fixed_frame in (BASE, ""))
    assert with_tf < 4.0 and with_tf < 0.6 * without


def test_the_floor_is_at_height_0_of_the_fixed_frame_and_live():
    above = Transforms()
    above.add(tf_message(BACKEND, 0, (BASE, FRAME, rpy(0, DOWN) * OPTICAL, (0, 0, HIGH))), static=True)
    config, settings = TrackerConfig(height=1.75), NodeSettings(fixed_frame=BASE, floor=True)
    session = Session(config, settings)
    session.set_camera(camera_info(BACKEND))
    session.placement.places.transforms = above
    assert session.process(cloud(BACKEND, SECOND, PIXELS[0]), 0).accepted
    assert session.placement.camera_height == pytest.approx(HIGH)
    assert np.allclose(session.tracker.floor, (0, 0, 1, 0))
    for floor in (False, True):
        session.tune(config, replace(settings, floor=floor))
        assert (session.placement.camera_height == pytest.approx(HIGH)) == floor
    tripod = Session(TrackerConfig(height=1.75), NodeSettings())
    tripod.tune(TrackerConfig(camera_height=1.4), NodeSettings())
    assert tripod.placement.camera_height == pytest.approx(1.4)


def test_a_floor_that_cannot_be_is_refused():
    with pytest.raises(ConfigurationError, match="floor is true, but no frame is named .* camera_height in place"):
        NodeSettings(floor=True).checked()
    with pytest.raises(ConfigurationError, match="camera_height is 1.2 and fixed_frame 'odom'; expected one of them"):
        Session(TrackerConfig(camera_height=1.2), NodeSettings(fixed_frame="odom"))
    session = Session(TrackerConfig(height=1.75), NodeSettings(fixed_frame="odom"))
    with pytest.raises(ConfigurationError, match="expected one of them"):
        session.tune(TrackerConfig(camera_height=1.2), NodeSettings(fixed_frame="odom"))
    assert session.tracker.config.camera_height == 0
    with pytest.raises(ConfigurationError, match="camera_height is -0.1; expected 0 to 100 m"):
        TrackerConfig(camera_height=-0.1).checked()


def test_replay_reads_tf_of_the_recording(tmp_path, capsys):
    """The camera's pitch from TF is that of the parameter; the joints are in the fixed frame."""
    frames = [(SECOND + i * 16_000_000, cloud(BACKEND, SECOND + i * 16_000_000, PIXELS[i])) for i in range(3)]
    tf = "tf2_msgs/msg/TFMessage"
    moving = tf_message(BACKEND, SECOND, (BASE, "head", rpy(0, DOWN)))
    messages = [
        ("/camera_info", "sensor_msgs/msg/CameraInfo", 1, camera_info(BACKEND)),
        ("/tf_static", tf, 2, tf_message(BACKEND, 0, ("head", FRAME, OPTICAL))),
        ("/tf", tf, SECOND - 1, moving),
        *(("/keypoints", "sensor_msgs/msg/PointCloud2", stamp, message) for stamp, message in frames),
    ]
    bag = write_messages(tmp_path / "in", messages)
    places = []
    for name, setting in (("tf", f"fixed_frame:={BASE}"), ("told", f"camera_pitch:={DOWN}")):
        assert main([str(bag), "-o", str(tmp_path / name), "-p", setting]) == 0
        poses = [message.poses for _, message in read(tmp_path / name, "/tracker/joints")]
        places.append([[pose.position.x, pose.position.y, pose.position.z] for pose in poses[-1]])
    assert np.allclose(places[0], (rpy(0, DOWN) * OPTICAL).apply(places[1]), atol=1e-4)
    assert "cameras         follow TF in the frame 'base_footprint'" in capsys.readouterr().out


def test_memory_of_transforms_is_limited():
    transforms = robot()
    for number in range(3 * MOST_FRAMES):
        transforms.add(tf_message(BACKEND, SECOND, ("map", f"frame_{number}", Rotation.identity())), static=False)
    assert len(transforms._frames) == MOST_FRAMES
    robot(transforms=transforms)  # moving frames are published again; fixed ones were kept
    for number in range(MOST_FRAMES):
        transforms.add(tf_message(BACKEND, SECOND, ("map", f"more_{number}", Rotation.identity())), static=False)
        if number % 100 == 0:
            robot(transforms=transforms)
    assert transforms.pose(FRAME, BASE, SECOND)[0].shape == (3, 3)
    transforms.add(tf_message(BACKEND, SECOND, ("map", "x" * (LONGEST_NAME + 1), Rotation.identity())), static=True)
    assert not any(len(name) > LONGEST_NAME for name in transforms._frames)
    for number in range(MOST_FRAMES):
        transforms.add(tf_message(BACKEND, 0, ("map", f"fixed_{number}", Rotation.identity())), static=True)
    assert len(transforms._frames) == MOST_FRAMES


def test_a_publisher_that_repeats_a_stamp_needs_no_memory():
    transforms = Transforms()
    for turn in range(5):
        transforms.add(tf_message(BACKEND, SECOND, (BASE, FRAME, rpy(0, 0.1 * turn))), static=False)
    assert len(transforms._frames[FRAME]._stamps) == 1
    assert np.allclose(transforms.pose(FRAME, BASE, SECOND)[0], rpy(0, 0.4).as_matrix())
    for number in range(MOST_STAMPS + 10):
        transforms._frames[FRAME].add(SECOND - number, (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
    assert len(transforms._frames[FRAME]._stamps) == MOST_STAMPS
