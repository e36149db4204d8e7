"""Leave-one-out runs: the pose prior is learned from all other takes of the folder, without the clip.

Only the prior is learned again. The tracker's constants do not change, and another clip of the same person may be among
those that the prior is learned from.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any, Callable, TypeVar

from benchmarks.accuracy_run.experiment import Job
from benchmarks.data.mocap import load_clip
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.evidence.pose_prior import PoseDistribution
from training.pose_prior import Moments, combined, mapping, moments, same_take

T = TypeVar("T")


def under_its_prior(function: Callable[[Job], T], job: Job) -> T:
    """Call function(job); if `job.left_out`, with the prior of the folder's other clips instead of the shipped one."""
    if not job.left_out:
        return function(job)
    with prior_in_force(prior_without(job.file)):
        return function(job)


def prior_without(file: Path) -> dict[str, Any]:
    """The prior of all clips in the file's folder that show another take, in the format of PosePrior."""
    others = [other for other in sorted(file.parent.glob("*.npz")) if not same_take(other.stem, file.stem)]
    if not others:
        raise SystemExit(f"no clip but {file.stem} in {file.parent}: expected others to learn its prior from")
    return mapping(*combined([sample for other in others for sample in _moments_of(other)]))


@lru_cache(maxsize=None)
def _moments_of(file: Path) -> list[Moments]:
    """Sample of a clip and its mirror image, computed once per process: 31 clips take a second."""
    return moments(load_clip(file))


@contextmanager
def prior_in_force(form: Mapping[str, Any]) -> Iterator[None]:
    """Replace the shipped prior in this process while the context is active.

    All methods call PosePrior.load when they are created. Users need no choice of prior, so the core has none; this
    context therefore replaces the method itself and restores it.
    """

    def load(cls: type[PoseDistribution], skeleton: Skeleton) -> PoseDistribution:
        return cls.from_mapping(form, skeleton)

    shipped = vars(PoseDistribution)["load"]
    setattr(PoseDistribution, "load", classmethod(load))
    try:
        yield
    finally:
        setattr(PoseDistribution, "load", shipped)
