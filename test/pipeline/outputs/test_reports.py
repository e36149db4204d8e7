"""Reports on people, their frames, the certificate and the state: thresholds and values by hand."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.lasso.certificate import Certificate
from lassokin_ros.core.lasso.problem import Lasso
from lassokin_ros.core.lasso.solver import LassoSolution
from lassokin_ros.core.observation import CameraPose, Status
from lassokin_ros.doubt.doubt import Doubt
from lassokin_ros.doubt.monitor import Judgement
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.outputs.body_frames import BodyFrames
from lassokin_ros.pipeline.outputs.frame_messages import certificate_status, principal_axes
from lassokin_ros.pipeline.outputs.scene_messages import PeopleMessages, PresenceState, confidence, person_report
from lassokin_ros.pipeline.people.roster import Presence
from lassokin_ros.pipeline.settings import NodeSettings
from msg_adapters.output_messages.builders import OK, WARN

SECOND = 10**9
TURNS = Rotation.from_euler("xyz", [[0.1, 0.2, 0.3], [-0.4, 0.5, 0.6], [0.7, -0.8, 0.9]]).as_matrix()
POSITIONS = np.array([[1.0, 2, 3], [0, 5, 1], [4, 1, 2]])


def estimate(repeated=0.0):
    return SimpleNamespace(pose=SimpleNamespace(positions=POSITIONS, orientations=TURNS), repeated=repeated)


def result(stamp_ns=SECOND, frame_id="a", wrong=0.25, person="", rejection=None, repeated=0.0):
    uncertainty = SimpleNamespace(failure_probability=wrong, absolute=SimpleNamespace(pelvis=np.eye(6)))
    velocity = np.array([1.0, 0, 0])
    return FrameResult(
        stamp_ns,
        frame_id,
        estimate(repeated),
        rejection,
        person=person,
        velocity=velocity,
        velocity_covariance=np.eye(3),
        tracker=SimpleNamespace(uncertainty=lambda _: uncertainty),
    )


@pytest.fixture
def people(monkeypatch):
    """PeopleMessages whose message is the list of reports."""
    builder = SimpleNamespace(fill=lambda stamp_ns, frame_id, reports, _: (stamp_ns, frame_id, reports))
    monkeypatch.setattr("lassokin_ros.pipeline.outputs.scene_messages.people_builder", lambda *_: builder)
    return PeopleMessages(None, "")


@pytest.mark.parametrize(
    ("age_s", "tracked"),
    [(-0.001, None), (0.0, True), (1.0, True), (1.001, False), (3.0, False), (3.001, None)],
)
def test_a_person_is_tracking_then_lost_then_left_out(people, age_s, tracked):
    people.update([result()], None)
    stamp_ns = SECOND + round(age_s * SECOND)
    stamp, frame_id, reports = people.build((stamp_ns, "a"), 1.0, 3.0)
    assert (stamp, frame_id) == (stamp_ns, "a") and [report.tracked for report in reports] == (
        [] if tracked is None else [tracked]
    )
    assert len(people.build((SECOND + 2 * SECOND, "a"), 2.0, 1.0)[2]) == (age_s >= 0)  # the longer of both counts


def test_repeated_keypoints_are_as_old_as_the_first_of_them(people):
    people.update([result(repeated=0.7)], None)
    (report,) = people.build((SECOND + SECOND // 5, "a"), 1.0, 3.0)[2]
    assert report.age == pytest.approx(0.9) and report.tracked
    (report,) = people.build((SECOND + 2 * SECOND // 5, "a"), 1.0, 3.0)[2]
    assert report.age == pytest.approx(1.1) and not report.tracked


def test_the_newest_result_of_each_person_who_is_present(people):
    people.update([result(1, person="p1"), result(2, person="p2"), result(3, person="p1", rejection="x")], ["p1", "p2"])
    reports = people.build((5, "a"), 1.0, 3.0)[2]
    assert [report.id for report in reports] == ["p1", "p2"]
    people.update([result(4, person="p2")], ["p2"])
    assert [report.id for report in people.build((4, "a"), 1.0, 3.0)[2]] == ["p2"]
    assert people.build((4, "b"), 1.0, 3.0)[2] == []
    people.forget()
    assert people.build((4, "a"), 1.0, 3.0)[2] == []


def test_the_report_on_a_person():
    report = person_report(result(), True)
    assert (report.id, report.tracked, report.confidence) == ("p1", True, 0.75)
    assert report.position.tolist() == [1, 2, 3] and report.velocity.tolist() == [1, 0, 0]
    assert report.joints is POSITIONS and np.array_equal(report.covariance, np.eye(6))
    front, left, up = Rotation.from_quat(report.quaternion).as_matrix().T
    assert np.allclose([left, up, front], TURNS[0].T)  # the root's axes are x left, y up, z front
    lost = person_report(result(person="p7"), False)
    assert (lost.id, lost.tracked, lost.confidence) == ("p7", False, 0.0)
    assert confidence(result(wrong=np.nan)) == 0.0 and confidence(result(wrong=1.0)) == 0.0


def test_who_is_not_seen_when_the_frame_jumps_is_moved_with_it(people):
    turn, shift = Rotation.from_euler("z", 90, degrees=True).as_matrix(), np.array([3.0, 0, 0])
    jump, again = (2 * SECOND, CameraPose("", turn, shift)), (4 * SECOND, CameraPose("", turn, shift))
    people.update([result(person="p1"), result(person="p2")], None)
    people.update([result(2 * SECOND, person="p1")], None, jump)  # already in the new frame
    stays, moved = people.build((2 * SECOND, "a"), 1.0, 9.0)[2]
    assert stays.position.tolist() == [1, 2, 3] and np.allclose(moved.position, [-2 + 3, 1, 3])
    assert np.allclose(moved.joints, POSITIONS @ turn.T + shift) and np.allclose(moved.velocity, [0, 1, 0])
    facing, before = (Rotation.from_quat(one.quaternion).as_matrix() for one in (moved, stays))
    assert np.allclose(facing, turn @ before) and np.allclose(moved.covariance, np.eye(6))
    people.update([result(2 * SECOND - 1, person="p3")], None, jump)  # held back by smoothing_lag
    people.update([], None, again)
    places = [one.position for one in people.build((4 * SECOND, "a"), 9.0, 9.0)[2]]
    once, twice = turn @ [1, 2, 3] + shift, turn @ (turn @ [1, 2, 3] + shift) + shift
    assert np.allclose(places, [once, twice, twice])
    people.update([], ["p2"], again)
    assert list(people._newest) == ["p2"]
    people.forget()
    assert not people._newest


def small():
    names = ("pelvis", "left_hip", "right_hip")
    return Skeleton("small", names, np.array([-1, 0, 1]), np.zeros((3, 3)), ("xzy",) * 3, 1.7)


@pytest.mark.parametrize("rep155", [False, True])
@pytest.mark.parametrize("publish", ["root", "all"])
def test_frames_of_a_body(rep155, publish):
    config = NodeSettings(publish_tf=publish, rep155=rep155, frame_prefix="~/")
    frames = BodyFrames(small(), config, "node", "p1")
    positions, quaternions = frames.transforms(estimate())
    assert len(frames.names) == len(positions) == len(quaternions)
    assert frames.names[0] == ("", "body_p1" if rep155 else "node/p1/body")
    assert positions[0] == pytest.approx([2, 3, 1.5] if rep155 else [1, 2, 3])  # between the hips, or the pelvis
    assert quaternions[0] == pytest.approx(result().quaternions[-1])
    if publish == "root":
        assert len(frames.names) == 1
        return
    root = "body_p1" if rep155 else ""
    links = [f"{name}_p1" if rep155 else f"node/p1/{name}" for name in ("pelvis", "left_hip", "right_hip")]
    assert frames.names[1:4] == [(root, links[0]), (links[0], links[1]), (links[1], links[2])]
    turns = Rotation.from_quat(quaternions[1:4]).as_matrix()
    for joint, parent in ((1, 0), (2, 1)):
        assert positions[joint + 1] == pytest.approx(TURNS[parent].T @ (POSITIONS[joint] - POSITIONS[parent]))
        assert turns[joint] == pytest.approx(TURNS[parent].T @ TURNS[joint])
    if rep155:  # its own frames stand at the joints
        assert sorted(frames.names[4:]) == [(links[1], "l_hip_p1"), (links[2], "r_hip_p1")] and not positions[4:].any()
    else:
        assert len(frames.names) == 4


def test_principal_axes_are_right_handed():
    random = np.random.default_rng(0)
    roots = random.normal(size=(20, 3, 3))
    covariance = np.concatenate([roots @ roots.swapaxes(1, 2), np.zeros((1, 3, 3)), [np.diag([1.0, 4, 9])]])
    quaternions, axes = principal_axes(covariance)
    turns = Rotation.from_quat(quaternions).as_matrix()
    assert np.allclose(turns @ (axes[:, :, None] ** 2 * turns.swapaxes(1, 2)), covariance)
    assert axes[-1].tolist() == [1, 2, 3] and not axes[-2].any() and (axes >= 0).all()
    assert not principal_axes(-1e-20 * np.eye(3)[None])[1].any()  # rounding below 0


@pytest.mark.parametrize(("kkt1", "level", "words"), [(1e-9, OK, "certified"), (0.5, WARN, "not certified")])
def test_the_line_of_a_certificate(kkt1, level, words):
    A = np.eye(5)[:, :2]
    B = np.zeros((5, 3))
    B[[2, 3, 4], [0, 1, 2]] = 1
    problem = Lasso(A, B, np.array([3.0, 0.25, 0, 0, 0]), np.array([1.0, 1.0]))
    certificate = Certificate(kkt1, 2e-9, 3e-9, 4.5, 5e-9, 6e-9, 1)
    solution = LassoSolution(np.array([2.0, 0]), np.zeros(3), problem.alpha, problem, "proxqp")
    vars(solution)["certificate"] = certificate
    increment = SimpleNamespace(problem=problem, solution=solution)
    found = SimpleNamespace(increment=increment, reprojection_px=1.23456789, initialised=True)
    doubt = Doubt(reversed=True, probability=0.125, unseen=("left leg", "right leg"))
    judgement = Judgement(doubt, ("this", "that"), 0.75)
    frame = FrameResult(SECOND, "optical", found, pending=SimpleNamespace(read=lambda: judgement))
    line = certificate_status(frame, "tracker: p1", "optical")
    assert (line.level, line.name, line.hardware_id) == (level, "tracker: p1: certificate", "optical")
    assert line.message == f"{words} to 1e-06 of alpha"
    assert line.values == {
        "kkt1 [alpha]": f"{kkt1:.6g}",
        "kkt2 [alpha]": "2e-09",
        "kkt3 [alpha]": "3e-09",
        "duality gap": "5e-09",
        "relative duality gap": "6e-09",
        "support size": "1",
        "certified": "true" if level == OK else "false",
        "reprojection error [px]": "1.23457",
        "theorem 1, condition 1 (< 1)": "0",
        "theorem 1, condition 2 (> 0) [rad]": "2",
        "theorem 1, condition 3 (= 0)": "0",
        "theorem 1 literal, condition 1 (< 1)": "0",
        "theorem 1 literal, condition 2 (> 0) [rad]": "2",
        "theorem 1 literal, condition 3 (= 0)": "0",
        "initialised": "true",
        "solved by": "proxqp",
        "likely wrong": "0.125",
        "doubtful": "true",
        "doubtful because": "this, that",
        "doubtful for [s]": "0.75",
        "limbs not seen": "left leg, right leg",
    }


def test_nobody_is_said_only_if_it_is_known():
    state = PresenceState()
    assert state.value == "lost"
    for status, informed, expected in (
        (Status.SEARCHING, False, "lost"),
        (Status.SEARCHING, True, "nobody"),
        (Status.SEARCHING, False, "lost"),
        (Status.TRACKING, False, "tracking"),
        (Status.LOST, False, "lost"),
    ):
        before = state.value
        assert state.update(Presence(status), 0, 1.0, 3.0, informed) == (before != expected)
        assert state.value == expected
    state.update(Presence(Status.LOST), 5 * SECOND, 1.0, 3.0, False)  # forgotten, and no images
    assert state.value == "lost"
    state.update(Presence(Status.LOST), 6 * SECOND, 1.0, 3.0, True)
    assert state.value == "nobody"
