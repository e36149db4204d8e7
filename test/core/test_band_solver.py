"""Small systems in one batch are each solved as if alone."""

import numpy as np
import pytest

from lassokin_ros.core.band_solver import BandSolver


@pytest.mark.parametrize(("h", "n"), [(12, 6), (12, 9), (3, 1), (1, 4)])
def test_each_system_has_its_own_solution(h, n):
    random = np.random.default_rng(h + n)
    A, g = random.normal(size=(h, n, n + 2)), random.normal(size=(h, n))
    A *= 10.0 ** random.uniform(-4, 4, size=(h, 1, 1))
    H, systems = A @ A.swapaxes(-1, -2), BandSolver(h, n)
    for _ in range(2):
        assert np.allclose(systems.solve(H, g), [np.linalg.solve(*each) for each in zip(H, g)], rtol=1e-6)


def test_one_indefinite_system_does_not_affect_the_others():
    H, g = np.tile(np.eye(3), (4, 1, 1)), np.ones((4, 3))
    H[2, 0, 0] = -1.0
    solution = BandSolver(4, 3).solve(H, g)
    assert np.allclose(solution[[0, 1, 3]], 1.0) and np.allclose(solution[2], [-1.0, 1.0, 1.0])
    H[2] = np.nan
    solution = BandSolver(4, 3).solve(H, g)
    assert np.allclose(solution[[0, 1, 3]], 1.0) and np.isnan(solution[2]).all()
    H[2] = 0.0
    with pytest.raises(np.linalg.LinAlgError):
        BandSolver(4, 3).solve(H, g)
