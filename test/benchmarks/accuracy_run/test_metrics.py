"""The metrics of the benchmarks, on cases with known results."""

import numpy as np
import pytest

from benchmarks.accuracy_run.metrics import (
    acceleration_error,
    flipped_frames,
    joint_errors,
    mpjpe,
    pa_mpjpe,
    procrustes,
    yaw_error,
)
from benchmarks.accuracy_run.runs import follow
from benchmarks.common.report import summarise, table
from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.estimate import Estimate
from lassokin_ros.core.observation import Observation, Rejection, Status

NAMES = ["l_hip", "r_hip", "l_knee", "l_ankle"]


def body(frames: int = 1) -> np.ndarray:
    joints = np.array([[0.1, 0.0, 3.0], [-0.1, 0.0, 3.0], [0.1, 0.4, 2.8], [0.1, 0.8, 3.0]])
    return np.repeat(joints[None], frames, axis=0)


def test_mpjpe_is_the_mean_distance_after_moving_the_roots_together():
    truth, root = body(), np.array([[0.0, 0.0, 3.0]])
    estimate = truth + [1.0, 2.0, 3.0]
    estimate[0, 3] += [0.03, 0.04, 0.0]
    assert mpjpe(estimate, truth, root + [1.0, 2.0, 3.0], root) == pytest.approx([50.0 / 4])


def test_mpjpe_leaves_out_joints_without_reference():
    truth, root = body(), np.zeros((1, 3))
    estimate = truth.copy()
    estimate[0, 0, 0] += 0.06
    truth[0, 1:3] = np.nan
    assert mpjpe(estimate, truth, root, root) == pytest.approx([30.0])


def test_joint_errors_are_means_over_both_sides_with_their_part_in_depth():
    truth, root = body(2), np.zeros((2, 3))
    estimate = truth.copy()
    estimate[:, 0] += [0.03, 0.0, 0.04]
    estimate[0, 2, 2] -= 0.02
    truth[1, 2] = truth[:, 3] = np.nan
    found = joint_errors(estimate, truth, root, root, NAMES)
    assert list(found) == ["hip", "knee"]
    assert found["hip"] == pytest.approx((25.0, 20.0)) and found["knee"] == pytest.approx((20.0, 20.0))


def test_pa_mpjpe_ignores_similarities_but_not_reflections():
    truth = body()
    turned = 1.3 * (truth - [0, 0, 2]) @ exponential(np.array([0.3, -1.0, 0.4])).T + [5.0, 1.0, 0.0]
    assert pa_mpjpe(turned, truth)[0] == pytest.approx(0.0, abs=1e-9)
    bent = np.array([[[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3.0]]])
    assert pa_mpjpe(bent * [-1, 1, 1], bent)[0] > 100
    assert np.allclose(procrustes(turned[0], truth[0]), truth[0])


def test_acceleration_error_of_a_parabola_is_twice_its_coefficient():
    truth, root = body(10), np.zeros((10, 3))
    fps, time = 50.0, np.arange(10) / 50.0
    estimate = truth.copy()
    estimate[..., 1] += 3.0 * time[:, None] ** 2
    assert acceleration_error(estimate, truth, root, root, fps) == pytest.approx(6.0)
    drifting = truth + 0.5 * time[:, None, None]
    assert acceleration_error(drifting, truth, root, root, fps) == pytest.approx(0.0, abs=1e-9)


def test_a_flip_needs_the_other_sign_and_more_than_100_mm():
    truth = body(4)  # the knee is 0.2 m nearer than the hip
    estimate = truth.copy()
    estimate[1, 2, 2] = 2.99  # 10 mm nearer: wrong by 190 mm, sign kept
    estimate[2, 2, 2] = 3.05  # other sign, wrong by 250 mm
    truth[3, 2, 2], truth[3, 3, 2] = 2.96, 2.96
    estimate[3, 2, 2], estimate[3, 3, 2] = 3.04, 3.04  # other sign, wrong by 80 mm only
    assert flipped_frames(estimate, truth, NAMES).tolist() == [False, False, True, False]


def test_yaw_error_is_the_rotation_of_the_hips_in_the_top_view():
    truth = body(3)
    estimate = truth.copy()
    estimate[1, [0, 1]] = truth[1, [1, 0]]
    estimate[2, 0] = estimate[2, 1] + [0.0, 0.5, 0.2]
    assert yaw_error(estimate, truth, NAMES) == pytest.approx([0.0, 180.0, 90.0])


class Scripted:
    """A follower that returns the given estimates in order."""

    def __init__(self, answers):
        self.answers = iter(answers)

    def track(self, observation):
        return next(self.answers)


def test_follow_holds_the_last_estimate_in_rejected_frames():
    class Pose:
        positions, landmarks = np.ones((2, 3)), np.ones((5, 3))

    frames = [Observation(float(i), np.zeros((5, 2)), np.ones(5), 1000.0) for i in range(4)]
    rejected = [Estimate(float(i), Status.SEARCHING, Rejection.TOO_FEW_LANDMARKS) for i in range(4)]
    accepted = Estimate(1.0, Status.TRACKING, pose=Pose(), reprojection_px=2.0)
    track = follow(Scripted([rejected[0], accepted, rejected[2], rejected[3]]), frames, joints=2, landmarks=5)
    assert track.first == 1
    assert np.isnan(track.positions[0]).all() and (track.positions[1:] == 1).all()
    assert track.rejected.tolist() == [True, False, True, True]
    assert np.isnan(track.reprojection_px[[0, 2, 3]]).all() and track.reprojection_px[1] == 2.0


def test_summary_has_median_and_mean_per_method():
    records = [{"method": "a", "mm": value} for value in (1.0, 2.0, 9.0, float("nan"))] + [{"method": "b", "mm": 5}]
    rows = summarise(records, ("method",), ["mm"])
    assert [(r["method"], r["statistic"], r["runs"], r["mm"]) for r in rows] == [
        ("a", "median", 4, 2.0),
        ("a", "mean", 4, 4.0),
        ("b", "median", 1, 5.0),
        ("b", "mean", 1, 5.0),
    ]


def test_table_aligns_columns_and_marks_missing_values():
    text = table([{"name": "x", "mm": 12.345}, {"name": "long", "mm": float("nan")}], {"name": "<", "mm": ".1f"})
    assert text.splitlines() == ["name    mm", "----  ----", "x     12.3", "long     -"]
