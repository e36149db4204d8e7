"""One tracked person's motion between messages: velocity, prediction, status over time, joint states."""

from types import SimpleNamespace

import numpy as np
import pytest

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.observation import CameraPose, Status
from lassokin_ros.pipeline.people.joint_angles import JointStates, Moment
from lassokin_ros.pipeline.people.tracked_person import LONGEST_PREDICTION_S, TrackedPerson

SECOND = 10**9
FACING = np.array([[[0.0, 0, 1], [0, -1, 0], [1, 0, 0]]])
"""The pelvis faces along x."""
LANDMARKS = np.array([[0.0, 0.0, 2.0], [0.5, -0.5, 2.5]])


@pytest.fixture
def person():
    return TrackedPerson(TrackerConfig(height=1.75, lost_after=1.0))


def at(place, initialised=False, turn=0.0):
    """An estimate with the pelvis at `place`."""
    rotations = np.tile(np.eye(3), (24, 1, 1))
    cosine, sine = np.cos(turn), np.sin(turn)
    rotations[5] = [[1, 0, 0], [0, cosine, -sine], [0, sine, cosine]]
    state = SimpleNamespace(translation=np.array(place, dtype=float), rotations=rotations)
    pose = SimpleNamespace(landmarks=LANDMARKS + place, positions=np.zeros((24, 3)) + place, orientations=FACING)
    return SimpleNamespace(state=state, pose=pose, initialised=initialised, stamp=0.0, up=np.array([0, -1.0, 0]))


def move(person, *steps):
    """(s, x) of the pelvis; the first one initialises."""
    for i, (seconds, x) in enumerate(steps):
        person._update_motion(round(seconds * SECOND), at([x, 0.0, 0.5 * x], i == 0), 1.75, None)


def test_before_the_first_frame_nothing_is_predicted(person):
    assert person.predicted_landmarks(SECOND) is None and person.unseen_s(SECOND) == float("inf")
    assert person.status is Status.SEARCHING and person.status_at(SECOND) is Status.SEARCHING


def test_the_velocity_ends_with_a_start_anew_and_outlasts_another_size(person):
    move(person, (1.0, 0.0), (1.1, 0.1), (1.2, 0.2))
    velocity = person._walk.velocity.copy()
    assert velocity[0] > 0.3
    person._update_motion(round(1.3 * SECOND), at([0.2, 0, 3.0]), 1.9, None)
    assert person._walk.velocity.tolist() == velocity.tolist()
    person._update_motion(round(1.4 * SECOND), at([9.0, 0, 0], initialised=True), 1.9, None)
    assert not person._walk.velocity.any()


def test_two_results_of_one_stamp_keep_the_velocity(person):
    """Another camera's image of the stamp came later, and is of use."""
    move(person, (1.0, 0.0), (1.1, 0.2))
    velocity = person._walk.velocity.copy()
    person._update_motion(round(1.1 * SECOND), at([0.21, 0.0, 0.1]), 1.75, None)
    assert person._walk.velocity.tolist() == velocity.tolist() and person._place.tolist() == [0.21, 0.0, 0.1]


def test_landmarks_are_predicted_to_move_sideways_for_a_while(person):
    move(person, (1.0, 0.0), (11.0, 1.0))
    place, speed = [1.0, 0.0, 0.5], person._walk.velocity[0]
    assert speed == pytest.approx(0.1, abs=0.05)
    for unseen_s, walks_s in ((0.0, 0.0), (0.2, 0.2), (LONGEST_PREDICTION_S,) * 2, (2.0, LONGEST_PREDICTION_S)):
        predicted = person.predicted_landmarks(round((11 + unseen_s) * SECOND))
        assert predicted == pytest.approx(project(LANDMARKS + place + [walks_s * speed, 0, 0]), abs=1e-6)  # depth stays
    further = person.predicted_landmarks(13 * SECOND, walks_s=2.0)
    assert further == pytest.approx(project(LANDMARKS + place + [2 * speed, 0, 0]), abs=1e-6)


def test_a_person_is_lost_after_a_while_without_a_message(person):
    move(person, (1.0, 0.0))
    person.status = Status.TRACKING
    assert person.unseen_s(3 * SECOND) == 2.0
    assert person.status_at(2 * SECOND) is Status.TRACKING  # lost_after itself
    assert person.status_at(2 * SECOND + 10**6) is Status.LOST and person.status is Status.TRACKING
    person.status = Status.SEARCHING
    assert person.status_at(9 * SECOND) is Status.SEARCHING


def test_a_person_moves_on_in_the_same_direction_when_the_frame_jumps(person):
    move(person, (1.0, 0.0), (11.0, 1.0))
    speed = person._walk.velocity[0]
    place, quarter = np.array([1.0, 0.0, 0.5]), np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    frame = CameraPose("map", quarter, np.array([0.2, 0.0, 0.0]))
    person.move_frame(frame, 11 * SECOND)
    expected = project(frame.into_camera(LANDMARKS + place) + [0, 0.2 * speed, 0])
    assert person.predicted_landmarks(round(11.2 * SECOND)) == pytest.approx(expected, abs=1e-6)


def test_joint_states_and_their_velocities():
    states = JointStates(("xyz",) * 24)
    first = Moment(SECOND, at([1, 2, 3]).state, True)
    second = Moment(SECOND + SECOND // 2, at([1, 2, 4], turn=0.1).state, False)
    positions, velocities = states.read(first, None)
    assert positions[:3].tolist() == [1, 2, 3] and not positions[3:].any() and not velocities.any()
    for _ in range(2):  # of the frame before, whichever was read last
        positions, velocities = states.read(second, first)
        assert velocities[:3] == pytest.approx([0, 0, 2]) and positions[3 + 3 * 5] == pytest.approx(0.1)
        assert velocities[3 + 3 * 5] == pytest.approx(0.2)
    assert not states.read(Moment(2 * SECOND, at([9, 9, 9]).state, True), second)[1].any()
    assert not states.read(second, None)[1].any()


def test_reset_forgets_the_motion(person):
    move(person, (1.0, 0.0), (1.1, 0.5))
    person.status = Status.TRACKING
    person.reset()
    assert person.predicted_landmarks(2 * SECOND) is None and person.seen_ns is None
    assert person.status is Status.SEARCHING and not person._walk.velocity.any() and person.flush() == []
