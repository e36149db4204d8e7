"""A camera that nobody has placed: its pose from the person, and when it is not believed."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from sequences import CONFIG, FOCAL

from lassokin_ros.core.body.kinematics import Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.image.frame_data import FrameData, View
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.learned.camera_finder import EVERY, FEWEST_FRAMES, CameraFinder
from lassokin_ros.core.learned.extrinsics import KEPT_EVERY_S, MOST_KEPT, Extrinsics
from lassokin_ros.core.learned.height import SizeCheck
from lassokin_ros.core.observation import CameraPose, Observation, Rejection, Status
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.demo.synthetic import motion

FRONT = CameraPose("front")
TURN = Rotation.from_euler("yxz", [80, 5, -3], degrees=True).as_matrix()
UP = np.array([0.0, -1.0, 0.0])


@pytest.fixture(scope="module")
def scene():
    """(kinematics, true poses of 8 s, ten a second, camera to be found)."""
    skeleton = Skeleton.load("anthropometric", 1.75)
    kinematics = Kinematics(skeleton, Layout.load("coco17", skeleton))
    truth = kinematics.pose(motion(skeleton, np.arange(80) * KEPT_EVERY_S))
    middle = truth.positions[:, 0].mean(0)
    return kinematics, truth, CameraPose("side", TURN, np.array([0.1, -0.2, 3.5]) - TURN @ middle)


def views(scene, frame, noise=0.0, shift=0.0):
    """What both cameras see in a frame; shift: m, by which the person is elsewhere for the side camera."""
    _, truth, side = scene
    random = np.random.default_rng(frame)
    seen = []
    for camera, place in ((FRONT, 0.0), (side, shift)):
        points = project(camera.into_camera(truth.landmarks[frame] + place))
        points = points + noise * random.normal(size=points.shape)
        seen.append(View(points, np.full(len(points), FOCAL / 3.0), camera=camera))
    return tuple(seen)


def filled(scene, extrinsics, noise=0.0, joint_noise=0.0, path=0.0):
    """Give all frames of the scene to `find`. path: m, how far the person whom the side camera sees is elsewhere."""
    _, truth, side = scene
    random = np.random.default_rng(7)
    for frame in range(80):
        shift = path * np.random.default_rng(frame).uniform(-1, 1, 3)
        joints = truth.positions[frame] + joint_noise * random.normal(size=(1, 3))
        own = side.into_camera(truth.positions[frame] + shift) + joint_noise * random.normal(size=(1, 3))
        extrinsics.find("side", frame * KEPT_EVERY_S, views(scene, frame, noise, shift), (joints, own))
    return extrinsics


def learner(scene):
    return Extrinsics(SizeCheck(scene[0]), True, "learn")


def apart(pose, other):
    """Degrees and m between two poses of a camera."""
    turn = Rotation.from_matrix(pose.rotation @ other.rotation.T).magnitude()
    return np.degrees(turn), np.linalg.norm(pose.centre - other.centre)


def test_exact_joints_give_the_exact_pose(scene):
    _, truth, side = scene
    finder = CameraFinder(KEPT_EVERY_S, MOST_KEPT)
    due = [
        finder.add(f * KEPT_EVERY_S, views(scene, f), (truth.positions[f], side.into_camera(truth.positions[f])))
        for f in range(80)
    ]
    assert [i + 1 for i, now in enumerate(due) if now] == list(range(FEWEST_FRAMES, 81, EVERY))
    found = finder.pose("side")
    assert found.name == "side" and np.linalg.det(found.rotation) == pytest.approx(1.0)
    assert np.allclose(found.rotation, side.rotation, atol=1e-9) and np.allclose(found.centre, side.centre, atol=1e-9)
    assert not finder.add(80 * KEPT_EVERY_S - 0.15, views(scene, 0), (truth.positions[0], truth.positions[0]))


def test_the_epipolar_lines_mend_a_pose_from_wrong_joints(scene):
    """Depths of both sides are off by 20 cm in each frame."""
    extrinsics = filled(scene, learner(scene), noise=1.0 / FOCAL, joint_noise=0.2)
    degrees, metres = apart(extrinsics.found["side"], scene[2])
    assert degrees < 1.0 and metres < 0.1


def test_a_pose_that_the_keypoints_contradict_is_not_used(scene):
    """The side camera sees another person, who goes another way."""
    extrinsics = filled(scene, learner(scene), path=1.0)
    assert not extrinsics.found


def test_a_found_pose_stays_after_a_reset_and_gives_way_to_a_given_one(scene):
    unknown = CameraPose("side", known=False)
    extrinsics = learner(scene)
    assert extrinsics.corrected(unknown) is unknown
    filled(scene, extrinsics)
    extrinsics.reset()
    found = extrinsics.found["side"]
    assert extrinsics.corrected(unknown) is found and extrinsics.received(found) is found
    assert not extrinsics.in_words("side")
    extrinsics.corrections["side"] = np.full(6, 0.1)
    kept = CameraPose("side", found.rotation.copy(), found.translation.copy())  # as of an earlier observation
    for same in (unknown, found, kept):
        assert apart(extrinsics.corrected(same), extrinsics.received(same)) == (0.0, 0.0)
        assert apart(extrinsics.corrected(same), found)[0] > 5.0
    assert extrinsics.corrected(scene[2]) is scene[2] and extrinsics.found["side"] is found
    assert extrinsics.received(scene[2]) is scene[2]
    assert not extrinsics.found and not extrinsics.corrections and extrinsics.corrected(unknown) is unknown


@pytest.mark.parametrize("setting", ["given", "check", "learn"])
def test_the_tracker_goes_on_with_the_placed_camera(scene, setting):
    kinematics, _, side = scene
    times = np.arange(8 * 30 if setting == "learn" else 15) / 30
    truth, random = kinematics.pose(motion(kinematics.skeleton, times)), np.random.default_rng(3)

    def observe(camera, frame):
        points = project((FRONT if camera is FRONT else side).into_camera(truth.landmarks[frame]))
        points = points + random.normal(size=points.shape) * 2.0 / FOCAL
        return Observation(times[frame], points, np.ones(len(points)), FOCAL, camera=camera)

    tracker = Tracker(replace(CONFIG, extrinsics=setting))
    unknown = CameraPose(side.name, known=False)
    first = tracker.track(observe(unknown, 0))
    assert (first.rejection, first.status) == (Rejection.UNPLACED, Status.SEARCHING)
    for frame in range(len(times)):
        estimate = tracker.track([observe(FRONT, frame), observe(unknown, frame)])
        assert estimate.accepted
    if setting != "learn":
        assert estimate.cameras == 1 and len(tracker._cameras) == 1
        return
    assert estimate.cameras == 2 and not tracker._unplaced.trackers
    degrees, metres = apart(tracker.learned.extrinsics.corrected(unknown), side)
    assert degrees < 3.0 and metres < 0.3


def test_a_few_wrong_points_hardly_move_the_pose(scene):
    """One landmark is 60 px off in the side camera, in every fourth frame."""
    _, truth, side = scene
    extrinsics = learner(scene)
    for frame in range(80):
        front, beside = views(scene, frame, noise=1.0 / FOCAL)
        beside.points[9] += (frame % 4 == 0) * 60.0 / FOCAL
        joints = truth.positions[frame]
        extrinsics.find("side", frame * KEPT_EVERY_S, (front, beside), (joints, side.into_camera(joints)))
    degrees, metres = apart(extrinsics.found["side"], side)
    assert degrees < 2.0 and metres < 0.15  # 3.3 degrees with Huber's weights


def test_images_that_come_faster_are_left_out_so_that_the_kept_ones_are_of_the_last_seconds(scene):
    """200 kept frames are 20 s, whatever the camera's rate is."""
    extrinsics, start = learner(scene), 1.7e9
    for camera in (FRONT, scene[2]):
        extrinsics.received(camera)
    for frame in range(61):  # 60 Hz for a second
        front, beside = views(scene, frame)
        extrinsics.update(start + frame / 60, FrameData((front, beside), UP))
    assert extrinsics.frame_count == pytest.approx(1 / KEPT_EVERY_S, abs=2)
