"""The depth estimator: positions and depths of the joints for a real pose, and what it passes to the network."""

import numpy as np
import pytest
from cases import FACING, body, random_body

from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.network.depth_estimator import DepthEstimator, _upright_image
from lassokin_ros.core.network.depth_network import LEAST_SEEN, PLACES, TARGETS, lengths_of, shipped_network

LEVEL = np.array([0.0, -1.0, 0.0])
HEIGHT = 1.75
KINEMATICS = body("coco17", HEIGHT)
ALL = np.ones(17, dtype=bool)
JOINTS = tuple(name for name in TARGETS if name in KINEMATICS.skeleton.joint_names)


def standing(yaw=0.6):
    """The pose of a person at 4 m with bent arms, turned about the vertical."""
    vectors = np.zeros((24, 3))
    for name, vector in {"left_shoulder": (0, 0, -1.2), "right_shoulder": (0, 0, 1.2), "left_elbow": (0, -1.0, 0),
                         "right_knee": (0.6, 0, 0), "right_hip": (-0.4, 0, 0)}.items():  # fmt: skip
        vectors[KINEMATICS.skeleton.index(name)] = vector
    rotations = exponential(vectors)
    rotations[0] = FACING @ exponential(np.array([0, yaw, 0]))
    return KINEMATICS.pose(BodyState(rotations, np.array([0.3, -0.1, 4.0])))


def watched(pose, up=LEVEL, mount=LEVEL, frames=10, estimator=None):
    """An estimator after some frames of a person who stands still."""
    estimator = estimator or DepthEstimator(shipped_network(), KINEMATICS)
    for frame in range(frames):
        estimator.update(10.0 + frame / 10, project(pose.landmarks), ALL, up, mount)
    return estimator


def positions(estimator):
    """The places that an estimator gives, by name; None without an estimate."""
    places = estimator.places
    return None if places is None else dict(zip(PLACES, places))


def from_the_hips(pose):
    """(joint name -> position relative to the middle of the hips) of a pose."""
    place = dict(zip(KINEMATICS.skeleton.joint_names, pose.positions))
    middle = 0.5 * (place["left_hip"] + place["right_hip"])
    return {name: position - middle for name, position in place.items()}


class Recorder:
    """A network that keeps the scenes it is asked about."""

    def __init__(self):
        self.scenes = []

    def estimate(self, scene, height):
        self.scenes.append(scene)
        return shipped_network().estimate(scene, height)


@pytest.mark.parametrize("yaw", [0.0, 0.6, -0.6, 2.5])
def test_positions_are_those_of_the_joints_in_the_camera_frame(yaw):
    pose = standing(yaw)
    found, truth = positions(watched(pose)), from_the_hips(pose)
    assert set(found) == {*TARGETS, "right_hip"}
    assert np.mean([np.linalg.norm(found[name] - truth[name]) for name in JOINTS]) < 0.07
    for side in ("left", "right"):
        assert np.linalg.norm(found[f"{side}_hip"] - truth[f"{side}_hip"]) < 0.05


def test_depths_are_those_of_the_positions_along_the_line_of_sight():
    estimator = watched(standing())
    depths, found = estimator.joint_depths, positions(estimator)
    assert np.linalg.norm(depths.sight) == pytest.approx(1) and depths.sight[2] > 0.95
    assert np.allclose(depths.depths, [found[name] @ depths.sight for name in TARGETS], rtol=0, atol=1e-6)
    assert depths.whitening.shape == (len(TARGETS), len(TARGETS)) and not np.triu(depths.whitening, 1).any()


def test_positions_are_in_metres_of_the_person():
    pose = standing()
    small = body("coco17", HEIGHT / 2)
    estimator, twin = DepthEstimator(shipped_network(), KINEMATICS), DepthEstimator(shipped_network(), small)
    for each in (estimator, twin):
        watched(pose, estimator=each)
    for name, position in positions(estimator).items():
        assert np.allclose(position, 2 * positions(twin)[name], rtol=0, atol=1e-5)
    assert np.allclose(twin.joint_depths.depths, estimator.joint_depths.depths / 2, rtol=0, atol=1e-5)
    assert np.allclose(twin.joint_depths.whitening, estimator.joint_depths.whitening * 2, rtol=1e-5)


def test_too_few_visible_points_give_no_estimate_and_the_next_frame_gives_one():
    estimator, points = DepthEstimator(shipped_network(), KINEMATICS), project(standing().landmarks)
    names = KINEMATICS.layout.names
    shown = [names.index(name) for name in ("left_hip", "right_hip", "left_knee", "right_knee", "left_shoulder")]
    for count, known in ((LEAST_SEEN - 1, False), (LEAST_SEEN, True), (LEAST_SEEN - 1, False)):
        seen = np.isin(np.arange(17), shown[:count])
        estimator.update(1.0 + count, points, seen, LEVEL, LEVEL)
        assert (estimator.joint_depths is not None) is known and (estimator.places is not None) is known
    assert estimator.reset() is None and estimator.joint_depths is None


@pytest.mark.parametrize("roll", [0.5, -0.5, np.pi / 2, np.pi])
def test_a_configured_roll_is_taken_out_of_the_image(roll):
    """The camera is turned about its optical axis, and the mount says so."""
    c, s = np.cos(roll), np.sin(roll)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    level = watched(standing())
    rolled = DepthEstimator(shipped_network(), KINEMATICS)
    for frame in range(10):
        points = project(standing().landmarks) @ turn[:2, :2].T
        rolled.update(10.0 + frame / 10, points, ALL, turn @ LEVEL, turn @ LEVEL)
    for name, position in positions(level).items():
        assert np.allclose(positions(rolled)[name], turn @ position, rtol=0, atol=1e-4), name
    assert np.allclose(rolled.joint_depths.sight, turn @ level.joint_depths.sight, rtol=0, atol=1e-6)


def test_the_motion_of_the_camera_is_none_of_the_person():
    """The camera turns, rolls and drives to where a still one is; both have then seen the same."""
    pose, still = standing(), watched(standing())
    moving, before = DepthEstimator(shipped_network(), KINEMATICS), (np.eye(3), np.zeros(3))
    for frame in range(10):
        left = (9 - frame) / 9
        now = exponential(np.array([0.1, 0.5, 0.2]) * left), np.array([0.4, 0.1, -0.5]) * left
        turn = now[0] @ before[0].T
        depth = (pose.landmarks @ before[0].T + before[1])[:, 2:]
        if frame:
            moving.carry(turn, (now[1] - turn @ before[1]) / depth)
        up = now[0] @ LEVEL
        moving.update(10.0 + frame / 10, project(pose.landmarks @ now[0].T + now[1]), ALL, up, up)
        before = now
    for name, position in positions(still).items():
        assert np.allclose(positions(moving)[name], position, rtol=0, atol=1e-5), name
    assert np.allclose(moving.joint_depths.whitening, still.joint_depths.whitening, rtol=1e-4, atol=1e-4)


def test_the_turn_of_the_image_brings_the_vertical_to_its_top():
    random = np.random.default_rng(0)
    for _ in range(20):
        up = random.normal(size=3)
        up /= np.linalg.norm(up)
        if np.hypot(*up[:2]) < 0.1:
            continue
        turn = _upright_image(up)
        assert np.allclose(turn @ turn.T, np.eye(3)) and np.linalg.det(turn) == pytest.approx(1)
        assert np.allclose(turn @ up, [0, -np.hypot(*up[:2]), up[2]])
    assert _upright_image(np.array([0.0, 0.05, 1.0])) is None  # it looks straight up
    assert _upright_image(np.array([0.0, -0.8, 0.6])) is None  # it is level


def test_the_network_sees_the_vertical_and_the_lengths_only_if_they_are_known():
    recorder = Recorder()
    estimator = DepthEstimator(recorder, KINEMATICS)
    points, skeleton = project(standing().landmarks), KINEMATICS.skeleton
    estimator.update(1.0, points, ALL, None, LEVEL)
    estimator.update(2.0, points, ALL, LEVEL, LEVEL)
    taller = skeleton.with_bone_scales(np.linspace(0.9, 1.1, 24))
    estimator.use_lengths(taller, True)
    estimator.update(3.0, points, ALL, LEVEL, LEVEL)
    unknown, known, long = recorder.scenes
    assert not unknown.up_known and known.up_known and np.array_equal(known.up, LEVEL)
    assert not known.lengths_known and long.lengths_known  # the built-in proportions are not measured ones
    assert np.array_equal(long.lengths, lengths_of(taller))


def test_a_skeleton_without_the_networks_joints_does_not_fit():
    assert DepthEstimator.fits(KINEMATICS) and not DepthEstimator.fits(random_body(np.random.default_rng(0)))
