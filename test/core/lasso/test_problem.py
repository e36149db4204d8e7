"""The problem's check, and the elimination of the translation on small matrices."""

import numpy as np
import pytest

from lassokin_ros.core.errors import SolverError
from lassokin_ros.core.lasso.problem import Lasso, eliminate_translation


def arrays(m=6, n=4):
    random = np.random.default_rng(0)
    shapes = {"A": (m, n), "B": (m, 3), "z": (m,)}
    return {name: random.normal(size=shape) for name, shape in shapes.items()} | {"alpha": np.ones(n)}


@pytest.mark.parametrize(
    ("field", "shape"), [("B", (5, 3)), ("B", (6, 2)), ("z", (5,)), ("z", (6, 1)), ("alpha", (5,)), ("alpha", (3,))]
)
def test_every_shape_is_checked(field, shape):
    Lasso(**arrays()).check_shapes()
    with pytest.raises(SolverError, match=rf"{field} \({', '.join(map(str, shape))}.*expected \(6, 4\), \(6, 3\)"):
        Lasso(**{**arrays(), field: np.ones(shape)}).check_shapes()


@pytest.mark.parametrize("alpha", [0.0, -1e-9])
def test_one_alpha_that_is_not_positive_is_refused(alpha):
    bad = {**arrays(), "alpha": np.array([1.0, 1, alpha, 1])}
    with pytest.raises(SolverError, match=f"the smallest alpha is {alpha}; expected every alpha above 0"):
        Lasso(**bad).check_values()
    Lasso(**{**arrays(), "alpha": np.array([1.0, 1, 1e-9, 1])}).check_values()


@pytest.mark.parametrize("rank", [3, 2, 1, 0])
def test_the_translation_is_eliminated_by_its_pseudo_inverse(rank):
    """Also where some directions of x cannot be seen: x is 0 there."""
    given = arrays()
    given["B"] = given["B"][:, :rank] @ np.random.default_rng(1).normal(size=(rank, 3))
    reduced = eliminate_translation(Lasso(**given))
    A, B, z = given["A"], given["B"], given["z"]
    M = np.eye(6) - B @ np.linalg.pinv(B)
    close = {"rtol": 0, "atol": 1e-10}
    assert np.allclose(reduced.Y, np.linalg.pinv(B), **close)
    assert np.allclose(reduced.A, M @ A, **close) and np.allclose(reduced.z, M @ z, **close)
    assert np.allclose(reduced.H, A.T @ M @ A, **close) and np.allclose(reduced.g, A.T @ M @ z, **close)


def test_a_direction_seen_a_thousand_times_less_is_still_seen():
    given = arrays()
    given["B"] = np.zeros((6, 3))
    given["B"][[0, 1, 2], [0, 1, 2]] = 1.0, 1e-3, 1e-6
    # 1e-12 of the largest square is below the limit of 1e-10, and 1e-6 is above it.
    assert np.allclose(np.diag(eliminate_translation(Lasso(**given)).Y), [1, 1e3, 0])


def test_the_reduction_is_computed_once():
    problem = Lasso(**arrays())
    assert problem.reduced is problem.reduced


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("value", [np.nan, np.inf, 1e200])
def test_values_that_overflow_are_refused_without_a_warning(value):
    given = arrays()
    given["A"][2, 1] = value
    eliminate_translation(Lasso(**given))  # the solver rejects what comes out
    if value == 1e200:
        given["alpha"] = np.full(4, 1e200)
    with pytest.raises(SolverError, match="not finite .or overflows"):
        Lasso(**given).check_values()
