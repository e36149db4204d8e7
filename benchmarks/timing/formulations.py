"""Lassos recorded from the tracker's own solver, and their solution in other formulations and by other solvers.

Each method computes (Omega, x) from a Lasso; the measured time includes all that it needs. Solvers are called with
`TOLERANCE` if they have a tolerance. No answer is trusted: benchmarks/solvers.py certifies each one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from importlib.util import find_spec
from typing import Any, Callable, Sequence

import numpy as np
import proxsuite
import qpsolvers

from benchmarks.accuracy_run.experiment import Job, scene_of
from benchmarks.accuracy_run.runs import Follower
from benchmarks.methods.baselines import PlainLasso
from lassokin_ros.core.lasso.problem import Lasso
from lassokin_ros.core.lasso.solver import LassoSolution, LassoSolver
from lassokin_ros.core.tracker import Tracker

KINDS = ("plain", "default")


@dataclass(frozen=True, eq=False)
class Recorded:
    """One lasso as the tracker posed it, without the columns that are zero in every pose.

    guess: the tracker's guess, or None; dead: number of columns left out. alpha contains the values used, after
    clamping.
    """

    problem: Lasso
    guess: np.ndarray | None = None
    dead: int = 0

    def anew(self) -> Recorded:
        """The same problem without the cached results of an earlier solve (`Lasso.reduced`)."""
        return replace(self, problem=replace(self.problem))

    def with_dead_columns(self) -> Lasso:
        """The same lasso with all degrees of freedom of the body, the dead ones last."""
        p = self.problem
        A = np.concatenate([p.A, np.zeros((len(p.z), self.dead))], axis=1)
        return Lasso(A, p.B, p.z, np.append(p.alpha, np.full(self.dead, np.median(p.alpha))))


class Recorder:
    """A wrapper around a LassoSolver that keeps the problems."""

    def __init__(self, solver: LassoSolver, degrees_of_freedom: int) -> None:
        self._solver = solver
        self._degrees_of_freedom = degrees_of_freedom
        self.recorded: list[Recorded] = []

    def solve(self, problem: Lasso, guess: np.ndarray | None = None, **more: Any) -> LassoSolution:
        """Solve, and keep the problem unless its answer is obviously 0."""
        solution = self._solver.solve(problem, guess, **more)
        if solution.method != "zero":
            # "K": columns keep their memory layout
            copy = Lasso(problem.A.copy("K"), problem.B.copy("K"), problem.z.copy(), solution.alpha.copy())
            dead = self._degrees_of_freedom - len(copy.alpha)
            self.recorded.append(Recorded(copy, None if guess is None else guess.copy(), dead))
        return solution


def record(kind: str, jobs: Sequence[Job], count: int) -> list[Recorded]:
    """Record `count` lassos over the jobs' clips, of the plain lasso ("plain") or the shipped tracker ("default")."""
    problems: list[Recorded] = []
    share = -(-count // len(jobs))
    for job in jobs:
        scene = scene_of(job)
        follower = scene.follower("plain" if kind == "plain" else "lasso")
        recorder = _recorder(follower, 3 * scene.skeleton.joint_count)
        for observation in scene.observations:
            follower.track(observation)
        chosen = np.linspace(0, len(recorder.recorded) - 1, min(share, len(recorder.recorded))).astype(int)
        problems += [recorder.recorded[i] for i in chosen]
    return problems[:count]


def _recorder(follower: Follower, degrees_of_freedom: int) -> Recorder:
    if isinstance(follower, PlainLasso):
        recorder = Recorder(follower._lasso, degrees_of_freedom)
        follower._lasso = recorder  # type: ignore[assignment]
        return recorder
    assert isinstance(follower, Tracker)
    recorder = Recorder(follower._increments.lasso, degrees_of_freedom)
    follower._increments.lasso = recorder  # type: ignore[assignment]
    return recorder


Answer = tuple[np.ndarray, np.ndarray]
Method = Callable[[Recorded], Answer]
TOLERANCE = 1e-10
"""Tolerance of the other solvers, set by benchmarks/solvers.py --tolerance. The default path has its own."""


def methods() -> dict[str, Method]:
    """All methods by name; the first is the default. Solvers that are not installed are left out."""
    peers = [name for name in ("daqp", "quadprog", "piqp", "osqp", "clarabel") if name in qpsolvers.available_solvers]
    result: dict[str, Method] = {
        "default (proxqp)": by_lasso_solver("proxqp"),
        "default, tracker's guess": by_lasso_solver("proxqp", guess=True),
        **{f"solver: {name}": by_lasso_solver(name) for name in peers},
        "primal split, ProxQP, cold": primal_split,
    }
    if find_spec("sklearn"):
        result["scikit-learn Lasso, warm"] = ByScikitLearn()
    return result


def by_lasso_solver(name: str, guess: bool = False) -> Method:
    """The package's own path with the QP solver `name`: dual, active set, certificate; objects are reused."""
    solver = LassoSolver(name)

    def solve(recorded: Recorded) -> Answer:
        solution = solver.solve(recorded.problem, recorded.guess if guess else None)
        solution.certificate  # computed on request, as the tracker requests it for every answer
        return solution.omega, solution.x

    return solve


def primal_split(recorded: Recorded) -> Answer:
    """Omega = p - n, p >= 0, n >= 0; ProxQP, a new object, box constraints.

    With all degrees of freedom, as in a first implementation, including those that move no landmark.
    """
    p, live = recorded.with_dead_columns(), recorded.problem.A.shape[1]
    n = p.A.shape[1]
    J = np.concatenate([p.B, p.A, -p.A], axis=1)
    linear = -J.T @ p.z
    linear[3:] += np.concatenate([p.alpha, p.alpha])
    lower = np.concatenate([np.full(3, -1e20), np.zeros(2 * n)])
    qp = proxsuite.proxqp.dense.QP(3 + 2 * n, 0, 0, True)
    qp.settings.eps_abs = TOLERANCE
    qp.init(J.T @ J, linear, None, None, None, None, None, lower, np.full(3 + 2 * n, 1e20))
    qp.solve()
    v = qp.results.x
    return (v[3 : 3 + n] - v[3 + n :])[:live], v[:3].copy()


class ByScikitLearn:
    """Coordinate descent on the projected lasso with columns divided by alpha, started from the tracker's guess.

    The Gram matrix is used if there are more rows than columns: the same answers in two thirds of the time.
    """

    def __init__(self) -> None:
        from sklearn.linear_model import Lasso as CoordinateDescent

        self._new = lambda rows, columns: CoordinateDescent(
            alpha=1 / rows,
            fit_intercept=False,
            precompute=rows > columns,
            warm_start=True,
            tol=TOLERANCE,
            max_iter=100_000,
        )
        self._models: dict[tuple[int, ...], CoordinateDescent] = {}

    def __call__(self, recorded: Recorded) -> Answer:
        """Solve one; x from KKT-3."""
        p = recorded.problem
        Y = np.linalg.solve(p.B.T @ p.B + 1e-12 * np.eye(3), p.B.T)
        A, z = p.A - p.B @ (Y @ p.A), p.z - p.B @ (Y @ p.z)
        model = self._models.setdefault(p.A.shape, self._new(*p.A.shape))
        if recorded.guess is not None:
            model.coef_ = recorded.guess * p.alpha
        model.fit(A / p.alpha, z)
        omega = model.coef_ / p.alpha
        return omega, Y @ (p.z - p.A @ omega)
