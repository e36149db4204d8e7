"""Lassos recorded from the tracker's own solver during tracking."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Sequence

import numpy as np

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
