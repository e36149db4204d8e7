"""Count the lassos of the trackers in this process, and the solves of their QP solver."""

from collections import Counter

import numpy as np

from lassokin_ros.core.lasso.dual import DualSolver
from lassokin_ros.core.lasso.solver import LassoSolver


def counted_solves(monkeypatch):
    """A Counter that grows: lassos; nontrivial, those of which 0 is not the solution; qp, first tries of the solver.

    methods: the names of the methods that found the answers of the nontrivial ones, as keys.
    """
    counts, solve_qp, solve_lasso = Counter(), DualSolver.solve, LassoSolver.solve

    def qp(self, reduced, alpha, effort, start=None):
        counts["qp"] += effort == 0
        return solve_qp(self, reduced, alpha, effort, start)

    def lasso(self, problem, guess=None):
        solution = solve_lasso(self, problem, guess)
        nontrivial = bool(np.any(np.abs(problem.reduced.g) > problem.alpha))
        counts["lassos"] += 1
        counts["nontrivial"] += nontrivial
        counts[f"by {solution.method}"] += nontrivial
        return solution

    monkeypatch.setattr(DualSolver, "solve", qp)
    monkeypatch.setattr(LassoSolver, "solve", lasso)
    return counts
