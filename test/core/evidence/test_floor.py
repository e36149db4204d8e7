"""The floor: rows against finite differences, lengths, cost; and stairs, a seat and a jump, which are no fault."""

from dataclasses import replace

import numpy as np
import pytest
from cases import body, one_view, random_state
from sequences import CONFIG, FOCAL, RATE, aligned_error

from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.body.proportions import Proportions
from lassokin_ros.core.body.roles import ANKLES
from lassokin_ros.core.evidence.feet import ANKLE_HEIGHT, FLOOR_DEVIATION, Floor
from lassokin_ros.core.evidence.frame_model import FrameModel
from lassokin_ros.core.evidence.pose_prior import PoseDistribution
from lassokin_ros.core.image.projection import huber_weights, project
from lassokin_ros.core.learned.vertical import level_from_camera, vertical_of
from lassokin_ros.core.observation import Observation
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.demo.synthetic import motion


@pytest.fixture
def scene():
    """A model, a state, and a frame with a floor on which both ankles are 2 cm too low."""
    kinematics = body()
    model = FrameModel(kinematics, PoseDistribution.load(kinematics.skeleton))
    random = np.random.default_rng(0)
    state = random_state(random, kinematics, 0.3)
    ankles = kinematics.pose(state).positions[[kinematics.skeleton.index(ankle) for ankle in ANKLES]]
    up = np.cross(ankles[1] - ankles[0], random.normal(size=3))  # both are at one height
    up /= np.linalg.norm(up)
    floor = np.append(up, ANKLE_HEIGHT * kinematics.skeleton.height - 0.02 - ankles[0] @ up)
    return model, state, one_view(np.zeros((17, 2)), np.ones(17), floor=floor)


def moved(model, state, step):
    omega = np.zeros(3 * model.kinematics.joint_count)
    omega[model.live] = step[:-3]
    return model.evaluate(state.retract(omega, step[-3:]))


def test_the_rows_are_the_derivative_of_the_ankles_height(scene):
    model, state, frame = scene
    found = model.linearise(model.evaluate(state), frame, huber_weights)
    which = found.rows[Floor.name]

    def errors(states, frame):
        return model.floor._errors(states, frame)[0][..., 0]

    steps = 1e-6 * np.eye(len(found.columns))
    jacobian = [
        (errors(moved(model, state, -step), frame) - errors(moved(model, state, step), frame)) / 2e-6 for step in steps
    ]
    weight = found.z[which] / errors(model.evaluate(state), frame)
    assert np.allclose(found.columns[:, which], weight * np.array(jacobian), atol=1e-5)
    assert np.allclose(found.columns[-3:, which], weight / FLOOR_DEVIATION * frame.floor[:3, None])


def test_the_pull_of_the_rows_is_the_gradient_of_the_cost(scene):
    model, state, frame = scene
    rows = model.linearise(model.evaluate(state), frame, huber_weights)
    which = rows.rows[Floor.name]
    steps = 1e-6 * np.eye(len(rows.columns))
    cost = [[float(model.floor.cost(moved(model, state, s * step), frame)) for s in (1, -1)] for step in steps]
    gradient = np.array([(above - below) / 2e-6 for above, below in cost])
    assert np.allclose(rows.columns[:, which] @ rows.z[which], -gradient, atol=1e-5 * np.abs(gradient).max())
    assert np.abs(gradient[-3:]).max() > 1  # the body as a whole is moved, too


def test_the_rows_of_the_lengths_are_the_gradient_of_the_cost(scene):
    model, state, frame = scene
    kinematics, proportions = model.kinematics, Proportions(model.kinematics)
    about = model.evaluate(state)
    rows = model.linearise(about, frame, huber_weights)
    which, motion_of = rows.rows[Floor.name], proportions.motion(about.pose, np.zeros(proportions.count))
    pull = model.length_rows(rows, about, frame, motion_of)[which].T @ rows.z[which]

    def cost(lengths):
        kinematics.set_skeleton(proportions.skeleton(lengths))
        return float(model.floor.cost(model.evaluate(state), frame))

    gradient = [(cost(step) - cost(-step)) / 2e-6 for step in 1e-6 * np.eye(proportions.count)]
    assert np.allclose(pull, -np.array(gradient), atol=1e-5)
    assert np.abs(pull[proportions.names.index("shank")]) > 1


def test_a_foot_far_from_the_floor_has_hardly_any_influence(scene):
    model, state, frame = scene
    about = model.evaluate(state)
    for off in (-0.4, 0.4):
        far = replace(frame, floor=frame.floor + (0, 0, 0, off))
        rows = model.linearise(about, far, huber_weights)
        assert np.abs(rows.z[rows.rows[Floor.name]]).max() < 0.3
        assert float(model.floor.cost(about, far)) < len(ANKLES) * 0.5 * Floor.scale**2


def test_several_states_at_once_give_the_same_as_each_alone(scene):
    model, state, frame = scene
    other = random_state(np.random.default_rng(1), model.kinematics, 0.3)
    both = BodyState(np.stack([state.rotations, other.rotations]), np.stack([state.translation, other.translation]))
    whole = model.linearise(model.evaluate(both), frame, huber_weights)
    costs = model.floor.cost(model.evaluate(both), frame)
    for number, one in enumerate((state, other)):
        alone = model.linearise(model.evaluate(one), frame, huber_weights)
        assert np.allclose(whole.columns[number], alone.columns, atol=1e-9)
        assert costs[number] == pytest.approx(float(model.floor.cost(model.evaluate(one), frame)))


def test_without_a_floor_there_are_no_rows(scene):
    model, state, frame = scene
    assert Floor.name not in model.linearise(model.evaluate(state), replace(frame, floor=None), huber_weights).rows


PITCH = 0.35
"""rad by which the camera looks down."""


def tracked(above=0.0, jump=False, told=True, seconds=1.5):
    """Mean errors of the root's place, of the joints, and of the ankles' height, m; and the tracker.

    The person stands `above` m above the floor, or jumps. told: whether the tracker is told the camera's
    height. The keypoints are those of a body that is 4 % taller, at the distance that the height says.
    """
    config = replace(CONFIG, camera_pitch=PITCH, calibrate=False)
    skeleton = Tracker(config).skeleton
    kinematics = body(height=skeleton.height)
    times = np.arange(round(seconds * RATE)) / RATE
    truth = kinematics.pose(motion(skeleton, np.full(len(times), 5.0)))
    lift = 0.4 * np.abs(np.sin(4 * times)) if jump else np.full(len(times), above)
    ankles = [skeleton.index(ankle) for ankle in ANKLES]
    camera_height = truth.positions[0, ankles, 1].max() + ANKLE_HEIGHT * skeleton.height
    into, raised = level_from_camera(0.0, PITCH), 1.2
    shift = np.stack([0 * times, raised - lift, 0.5 + 0 * times], axis=-1)[:, None]
    positions, landmarks = ((part + shift) @ into for part in (truth.positions, truth.landmarks))
    height = camera_height + raised
    tracker = Tracker(replace(config, camera_height=height if told else 0.0))
    random, errors = np.random.default_rng(3), []
    for index, time in enumerate(times):
        body_centre = landmarks[index].mean(axis=0)
        seen = project(body_centre + 1.04 * (landmarks[index] - body_centre))
        seen = seen + 2.0 / FOCAL * random.normal(size=seen.shape)
        estimate = tracker.track(Observation(float(time), seen, np.ones(len(seen)), FOCAL))
        root = float(np.linalg.norm(estimate.pose.positions[0] - positions[index, 0]))
        off = (estimate.pose.positions[ankles] - positions[index, ankles]) @ vertical_of(0.0, PITCH)
        errors.append((root, aligned_error(estimate, positions[index]), np.abs(off).mean()))
    return (*np.mean(errors[5:], axis=0), tracker)


def test_a_person_on_the_floor_is_placed_by_it():
    with_floor, without = tracked(), tracked(told=False)
    assert with_floor[0] < without[0] - 0.01 and with_floor[1] < without[1] + 0.005
    assert with_floor[2] < without[2] - 0.003
    assert without[3].floor is None and np.allclose(with_floor[3].floor[:3], vertical_of(0.0, PITCH))


@pytest.mark.parametrize("case", [{"above": 0.17}, {"above": 0.45}, {"above": -0.17}, {"jump": True}])
def test_stairs_seats_and_jumps_are_no_fault(case):
    with_floor, without = tracked(**case), tracked(**case, told=False)
    assert with_floor[0] < without[0] + 0.02 and with_floor[1] < without[1] + 0.005
