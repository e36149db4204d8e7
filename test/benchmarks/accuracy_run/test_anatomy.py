"""Angles, lean, sliding feet and exchanged sides of a track, on figures whose values are known."""

import numpy as np
import pytest

from benchmarks.accuracy_run.anatomy import FIGURES, body_figures, exchanged_frames, flexion, still_feet

NAMES = "l_hip r_hip l_knee r_knee l_ankle r_ankle l_shoulder r_shoulder l_elbow r_elbow l_wrist r_wrist".split()
LEG = ("hip", "knee", "ankle")
STAMPS = np.arange(40) / 20


def standing(frames=40, knee=0.0, elbow=0.0, lean=0.0):
    """(f, 12, 3) m, camera frame: a person who looks to the camera, joints bent and trunk leant forward in degrees."""
    knee, elbow, lean = np.radians([knee, elbow, lean])
    points = {}
    for side, x in (("l", 1.0), ("r", -1.0)):
        points[f"{side}_hip"] = np.array([0.1 * x, 0.0, 4.0])
        points[f"{side}_knee"] = points[f"{side}_hip"] + [0, 0.4, 0]
        points[f"{side}_ankle"] = points[f"{side}_knee"] + [0, 0.4 * np.cos(knee), 0.4 * np.sin(knee)]
        points[f"{side}_shoulder"] = np.array([0.18 * x, -0.5 * np.cos(lean), 4.0 - 0.5 * np.sin(lean)])
        points[f"{side}_elbow"] = points[f"{side}_shoulder"] + [0, 0.3, 0]
        points[f"{side}_wrist"] = points[f"{side}_elbow"] + [0, 0.25 * np.cos(elbow), -0.25 * np.sin(elbow)]
    return np.tile([points[name] for name in NAMES], (frames, 1, 1))


def test_a_perfect_track_has_no_error():
    figures = body_figures(standing(knee=20, elbow=70), standing(knee=20, elbow=70), NAMES, STAMPS)
    assert list(figures) == FIGURES and all(abs(value) < 1e-5 for value in figures.values())


def test_bends_and_leans_have_their_sign():
    figures = body_figures(standing(knee=30, elbow=10, lean=8), standing(knee=10, elbow=40), NAMES, STAMPS)
    assert figures["knee_bias_deg"] == pytest.approx(20) and figures["knee_error_deg"] == pytest.approx(20)
    assert figures["elbow_bias_deg"] == pytest.approx(-30) and figures["elbow_error_deg"] == pytest.approx(30)
    assert figures["trunk_bias_deg"] == pytest.approx(8) and figures["trunk_error_deg"] == pytest.approx(8)
    back = body_figures(standing(lean=-5), standing(), NAMES, STAMPS)
    assert back["trunk_bias_deg"] == pytest.approx(-5) and back["trunk_error_deg"] == pytest.approx(5)


def test_biases_cancel_and_errors_do_not():
    estimate = np.concatenate([standing(20, knee=15), standing(20, knee=35)])
    figures = body_figures(estimate, standing(knee=25), NAMES, STAMPS)
    assert abs(figures["knee_bias_deg"]) < 1e-9 and figures["knee_error_deg"] == pytest.approx(10)


def test_a_foot_slides_only_while_the_true_one_stands():
    truth = standing()
    truth[20:, 5, 0] += 0.1 * np.arange(20)  # the right ankle steps away, at 2 m/s
    estimate = truth.copy()
    estimate[:, [4, 5], 2] += 0.2 * STAMPS[:, None]  # both ankles drift at 0.2 m/s
    estimate[1::2, [4, 5], 1] += 0.01  # and shake by 1 cm
    still = still_feet(truth[:, [4, 5]], STAMPS)
    assert still[:15].all() and still[20:35, 0].all() and not still[19:, 1].any() and not still[36:].any()
    figures = body_figures(estimate, truth, NAMES, STAMPS)
    assert 200 <= figures["slide_mm_s"] < 210  # 5 frames: the shaking adds 1 cm across the drift of 5 cm
    assert figures["skate_mm_s"] == pytest.approx(1000 * np.hypot(0.2, 0.01 * 20))


def test_feet_that_never_stand_have_no_slide():
    walking = standing()
    walking[:, :, 0] += STAMPS[:, None]
    figures = body_figures(walking, walking, NAMES, STAMPS)
    assert np.isnan(figures["slide_mm_s"]) and np.isnan(figures["skate_mm_s"]) and figures["knee_error_deg"] < 1e-6


def test_exchanged_legs_and_arms_are_counted_wherever_the_body_is():
    truth = standing()
    estimate = truth + [0.5, -0.2, 2.0]
    estimate[:10, [0, 2, 4]], estimate[:10, [1, 3, 5]] = estimate[:10, [1, 3, 5]], estimate[:10, [0, 2, 4]]
    estimate[5:14, [6, 8, 10]], estimate[5:14, [7, 9, 11]] = estimate[5:14, [7, 9, 11]], estimate[5:14, [6, 8, 10]]
    exchanged, known = exchanged_frames(estimate, truth, NAMES)
    assert known.all() and np.flatnonzero(exchanged).tolist() == list(range(14))
    assert body_figures(estimate, truth, NAMES, STAMPS)["exchanged_percent"] == pytest.approx(35)


def test_unknown_joints_are_left_out():
    truth = standing(knee=10)
    truth[:, [2, 4, 8]] = np.nan
    truth[30:] = np.nan
    figures = body_figures(standing(knee=25), truth, NAMES, STAMPS)
    assert figures["knee_bias_deg"] == pytest.approx(15) and np.isnan(figures["exchanged_percent"])
    assert np.isnan(flexion(truth, NAMES, "l", LEG)).all() and np.isfinite(flexion(truth, NAMES, "r", LEG)[:30]).all()
