"""Measured depths of the body's own surface."""

import numpy as np

from lassokin_ros.core.image.depth_gating import HIDDEN, SAME_SURFACE, of_own_surface

SURFACE = np.full(5, 0.05)


def test_depths_of_hidden_landmarks_are_missing_and_others_are_corrected():
    #                     own surface, thicker, hidden, hidden by the last pose only, no body on the line of sight
    landmarks = np.full(5, 3.0)
    nearest = np.array([2.95, 2.92, 2.7, 2.7, np.inf])
    depth = np.array([2.95, 2.92, 2.71, 2.95, 2.9])
    own = of_own_surface(depth, landmarks, nearest, SURFACE, 1.75) + SURFACE
    assert np.allclose(own[:2], 3.0) and np.isnan(own[2])
    assert np.allclose(own[3:], depth[3:] + 0.05)  # not the surface of the last pose


def test_corrections_have_limits():
    landmarks, nearest = np.full(5, 3.0), np.array([2.95 - HIDDEN * 1.75 + 0.001, 3.0, 3.1, 2.95, 2.95])
    depth = np.array([*nearest[:3], 2.95 - SAME_SURFACE - 0.01, np.nan])
    own = of_own_surface(depth, landmarks, nearest, SURFACE, 1.75) + SURFACE
    assert np.isclose(own[0], 3.0) and np.isclose(own[1], 3.025) and np.isclose(own[2], 3.125)
    assert np.isclose(own[3], depth[3] + 0.05) and np.isnan(own[4])
