"""The certificate of a small problem, every figure worked out by hand."""

from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest

from lassokin_ros.core.lasso.certificate import Certificate, certify

A = np.eye(5)[:, :3]
"""Degree of freedom k moves number k; the translation moves the fourth and the fifth."""
B = np.array([[0.0, 0, 0], [0, 0, 0], [0, 0, 0], [2, 0, 0], [0, 1, 0]])
Z = np.array([3.0, -5.0, 0.5, 4.0, 1.0])
ALPHA = np.array([1.0, 2.0, 4.0])
BEST = np.array([2.0, -3.0, 0.0]), np.array([2.0, 1.0, 0.0])
"""Soft thresholding of z by alpha; the translation explains the last two numbers."""


def certificate(omega, x):
    return certify(A, B, Z, ALPHA, np.asarray(omega, dtype=float), np.asarray(x, dtype=float))


def test_the_minimiser_has_residuals_and_gap_of_zero():
    found = certificate(*BEST)
    assert (found.kkt1, found.kkt2, found.kkt3, found.support_size) == (0, 0, 0, 2)
    assert found.objective == 0.5 * (1 + 4 + 0.25) + 1 * 2 + 2 * 3
    assert found.duality_gap == 0 and found.relative_gap == 0 and found.kkt_residual == 0


def test_a_value_that_is_off_by_a_tenth_shows_in_units_of_its_alpha():
    found = certificate([2.0, -3.1, 0.0], BEST[1])  # r_2 = -1.9 instead of -2
    assert (found.kkt1, found.kkt2, found.kkt3) == (pytest.approx(0.05), 0, 0)
    assert found.objective == pytest.approx(0.5 * (1 + 3.61 + 0.25) + 2 + 6.2)
    # r is feasible as it is: the dual's value is r z - r^2 / 2.
    dual = 3 + 9.5 + 0.25 - 0.5 * (1 + 3.61 + 0.25)
    assert found.duality_gap == pytest.approx(found.objective - dual)
    assert found.relative_gap == pytest.approx(found.duality_gap / (0.5 * Z @ Z))


def test_a_degree_of_freedom_that_ought_to_move_shows_in_kkt2():
    found = certificate([0.0, -3.0, 0.0], BEST[1])  # the correlation of the first is 3 alpha
    assert (found.kkt1, found.kkt2, found.kkt3, found.support_size) == (0, 2, 0, 1)
    assert found.objective == 0.5 * (9 + 4 + 0.25) + 6
    # Scaled down by 3, r is feasible.
    r = np.array([3.0, -2, 0.5, 0, 0]) / 3
    assert found.duality_gap == pytest.approx(found.objective - (r @ Z - 0.5 * r @ r))


def test_correlations_just_below_alpha_are_no_violation():
    found = certify(A, B, np.array([0.5, 0, 0, 0, 0]), ALPHA, np.zeros(3), np.zeros(3))
    assert (found.kkt1, found.kkt2, found.kkt3, found.support_size, found.objective) == (0, 0, 0, 0, 0.125)
    assert found.duality_gap == 0


def test_a_wrong_translation_shows_in_units_of_the_smallest_alpha():
    found = certify(A, B, Z, 0.5 * ALPHA, np.array([2.5, -4.0, 0.0]), np.array([1.5, 1.0, 0.0]))
    assert (found.kkt1, found.kkt2) == (0, 0)
    assert found.kkt3 == 4.0  # r_4 = 1, twice in B^T r, over 0.5
    assert found.kkt_residual == 4.0


def test_the_relative_gap_of_an_answer_far_off_is_in_units_of_its_objective():
    found = certificate([20.0, -3.0, 0.0], BEST[1])
    assert found.objective > 0.5 * Z @ Z
    assert found.relative_gap == pytest.approx(found.duality_gap / found.objective)


def test_a_problem_of_zeros_has_no_gap():
    found = certify(A, B, np.zeros(5), ALPHA, np.zeros(3), np.zeros(3))
    assert (found.objective, found.duality_gap, found.relative_gap, found.kkt_residual) == (0, 0, 0, 0)


@pytest.mark.parametrize("which", ["kkt1", "kkt2", "kkt3"])
def test_the_largest_residual_counts_and_nan_is_infinite(which):
    residuals = Certificate(0.25, 0.25, 0.25, 1.0, 0.0, 0.0, 1)
    assert residuals.kkt_residual == 0.25
    assert replace(residuals, **{which: 0.5}).kkt_residual == 0.5
    assert replace(residuals, **{which: np.nan}).kkt_residual == np.inf


def test_a_certificate_cannot_be_changed():
    with pytest.raises(FrozenInstanceError):
        certificate(*BEST).kkt1 = 0.0


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("value", [np.nan, np.inf, 1e200])
def test_a_wrong_answer_is_not_certified_and_gives_no_warning(value):
    found = certificate([value, -3.0, 0.0], BEST[1])
    assert not found.kkt_residual < 1
