"""Feet on the floor and feet that stand still: rows, lengths, cost; stairs, a seat and a jump are no fault."""

from dataclasses import replace

import numpy as np
import pytest
from cases import assert_states_are_alike, body, one_view, pull_and_gradient, random_body, random_state
from sequences import CONFIG, FOCAL, RATE, aligned_error

from lassokin_ros.core.body.proportions import Proportions
from lassokin_ros.core.body.roles import ANKLES
from lassokin_ros.core.evidence.feet import ANKLE_HEIGHT, Floor, FootContact
from lassokin_ros.core.evidence.frame_model import FrameModel
from lassokin_ros.core.evidence.pose_prior import PoseDistribution
from lassokin_ros.core.image.projection import huber_weights, project
from lassokin_ros.core.kernel import kernel
from lassokin_ros.core.learned.vertical import level_from_camera, vertical_of
from lassokin_ros.core.observation import Observation
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.demo.synthetic import motion

DEVIATION = 0.02


def scene():
    """A model, a state, its ankles' places, and a frame without feet."""
    kinematics = body()
    model = FrameModel(kinematics, PoseDistribution.load(kinematics.skeleton))
    state = random_state(np.random.default_rng(0), kinematics, 0.3)
    ankles = kinematics.pose(state).positions[[kinematics.skeleton.index(ankle) for ankle in ANKLES]]
    return model, state, ankles, one_view(np.zeros((17, 2)), np.ones(17))


@pytest.fixture
def floor():
    """A model, a state, and a frame with a floor on which both ankles are 2 cm too low."""
    model, state, ankles, frame = scene()
    up = np.cross(ankles[1] - ankles[0], [0.3, -1.0, 0.5])  # both are at one height
    up /= np.linalg.norm(up)
    height = ANKLE_HEIGHT * model.kinematics.skeleton.height
    return model, state, replace(frame, floor=np.append(up, height - 0.02 - ankles[0] @ up))


@pytest.fixture
def contact():
    """A model, a state, and a frame in which the left ankle is 1 and 2 cm off its anchor, and the right one is free."""
    model, state, ankles, frame = scene()
    anchors = ankles + np.array([[0.01, -0.02, 0.0], [0.3, 0.3, 0.3]])
    return model, state, replace(frame, anchors=anchors, stiffness=np.array([1 / DEVIATION, 0.0]))


PIECES = pytest.mark.parametrize("name", [Floor.name, FootContact.name])


def of(name, request):
    model, state, frame = request.getfixturevalue("floor" if name == Floor.name else "contact")
    return model, model.pieces[name], state, frame


@PIECES
@pytest.mark.parametrize("compiled", [True, False])
def test_the_pull_of_the_rows_is_the_gradient_of_the_cost(name, compiled, request):
    with kernel.switched(compiled):
        pull, gradient = pull_and_gradient(*of(name, request))
    assert np.allclose(pull, gradient, atol=1e-5 * np.abs(gradient).max())
    assert np.abs(gradient[-3:]).max() > 1  # the body as a whole is moved, too


@PIECES
def test_several_states_at_once_give_the_same_as_each_alone(name, request):
    model, piece, state, frame = of(name, request)
    other = random_state(np.random.default_rng(1), model.kinematics, 0.3)
    assert_states_are_alike(model, piece, (state, other), frame)


def test_the_kernel_and_python_give_the_same_rows_of_contacts(contact):
    model, state, frame = contact
    found = []
    for compiled in (True, False):
        with kernel.switched(compiled):
            found.append(model.linearise(model.evaluate(state), frame, huber_weights))
    assert np.allclose(found[0].columns, found[1].columns, atol=1e-9) and np.allclose(found[0].z, found[1].z, atol=1e-9)


@PIECES
def test_without_its_data_there_are_no_rows(name, request):
    model, _, state, frame = of(name, request)
    without = replace(frame, floor=None, anchors=None)
    assert name not in model.linearise(model.evaluate(state), without, huber_weights).rows


def test_a_skeleton_without_ankles_has_no_rows_of_feet():
    other = random_body(np.random.default_rng(0))
    model = FrameModel(other, PoseDistribution.load(other.skeleton))
    assert model.foot_contact is None and model.floor is None


def test_the_rows_of_the_lengths_are_the_gradient_of_the_cost(floor):
    model, state, frame = floor
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


def test_a_foot_far_from_the_floor_has_hardly_any_influence(floor):
    model, state, frame = floor
    about = model.evaluate(state)
    for off in (-0.4, 0.4):
        far = replace(frame, floor=frame.floor + (0, 0, 0, off))
        rows = model.linearise(about, far, huber_weights)
        assert np.abs(rows.z[rows.rows[Floor.name]]).max() < 0.3
        assert float(model.floor.cost(about, far)) < len(ANKLES) * 0.5 * Floor.scale**2


def test_a_foot_without_contact_has_no_rows_and_no_cost(contact):
    model, state, frame = contact
    about = model.evaluate(state)
    rows = model.linearise(about, frame, huber_weights)
    right = slice(rows.rows[FootContact.name].start + 3, rows.rows[FootContact.name].stop)
    assert not rows.columns[:, right].any() and not rows.z[right].any()
    square = (0.01**2 + 0.02**2) / DEVIATION**2
    assert model.foot_contact.cost(about, frame) == pytest.approx(0.5 * square / (1 + square / FootContact.scale**2))


def test_a_wrong_anchor_has_hardly_any_influence(contact):
    model, state, frame = contact
    frame.anchors[0] += (0.5, 0.0, 0.0)
    rows = model.linearise(model.evaluate(state), frame, huber_weights)
    assert np.abs(rows.z[rows.rows[FootContact.name]]).max() < 0.6
    assert float(model.foot_contact.cost(model.evaluate(state), frame)) < 0.5 * FootContact.scale**2


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
