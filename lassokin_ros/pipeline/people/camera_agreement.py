"""Which of several cameras contradicts the others, as the person shows in whom all of them must agree.

Each pair of cameras that sees one person is compared as in `matching.py`. A camera that fits no other one, while
others fit each other, is left out until it fits again: its images are another camera's, its pose or its lens is wrong.
Of two cameras alone it cannot be told which one is wrong. What is wrong is said by `pipeline/camera/rig_check.py`.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from lassokin_ros.core.image.projection import norm, project
from lassokin_ros.core.learned.height import SizeCheck
from lassokin_ros.pipeline.camera.rig_check import CHECK
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.people.matching import compared, triangulated
from lassokin_ros.pipeline.seen import Sight

LEFT_OUT = "left out, does not fit the others"
"""Key of the count of images of a camera that is left out; the camera's name precedes it."""
WRONG, RIGHT = 0.15, 0.1
"""Median cost above which two cameras contradict each other, and below which they fit. With right cameras it is 0.01 to
0.05, and at most 0.14 (Shelf, Wildflower, videos)."""
PERIOD_NS, JUDGED = 90_000_000, 10
"""ns between two comparisons of a pair (every third image at 30 Hz); number of those judged, of the last second."""
LONGEST_APART_NS = 50_000_000
"""ns: largest difference of the stamps of two sights that are compared."""
WORSE = 1.5
"""Ratio of the costs by which one of two cameras with the same keypoints must fit a third one worse to be left out."""
RESIDUALS = 30
"""Number of images whose residuals are kept."""
SAME_PX = 1.0
"""px: median distance of the keypoints of two cameras below which they are of one image."""


@dataclass
class _Pair:
    """The last comparisons of two cameras. newest_ns: ns, of the last one; same: whether the keypoints were equal."""

    newest_ns: int = 0
    costs: deque[float] = field(default_factory=lambda: deque(maxlen=JUDGED))
    same: deque[bool] = field(default_factory=lambda: deque(maxlen=JUDGED))

    @property
    def cost(self) -> float | None:
        """The median cost; None if it is not known."""
        return sorted(self.costs)[JUDGED // 2] if len(self.costs) == JUDGED else None

    @property
    def is_wrong(self) -> bool:
        """Whether the cameras contradict each other."""
        return self.cost is not None and self.cost > WRONG

    @property
    def is_right(self) -> bool:
        """Whether the cameras fit each other."""
        return self.cost is not None and self.cost < RIGHT

    @property
    def is_same(self) -> bool:
        """Whether both cameras have the same keypoints."""
        return len(self.same) == JUDGED and sum(self.same) > JUDGED // 2


class CameraAgreement:
    """Compares the sights of one person by several cameras."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget all sights and judgements."""
        self._newest: dict[str, Sight] = {}
        self._pairs: dict[frozenset[str], _Pair] = {}
        self.left_out: dict[str, str] = {}
        """Why a camera is left out, in words, by name."""
        self.residuals: dict[str, deque[float]] = {}
        """px, by camera: median distances of a person's landmarks from the keypoints of the last images."""

    def is_due(self, name: str, stamp_ns: int) -> bool:
        """Return whether the sight of a camera at a stamp, ns, is of use."""
        return name not in self._newest or abs(stamp_ns - self._newest[name].stamp_ns) >= PERIOD_NS

    def update(self, sights: Sequence[Sight], size: SizeCheck) -> None:
        """Use the sights of one person in images of one instant. size: of the person's body."""
        self._newest |= {sight.camera.name: sight for sight in sights}
        for sight in sights:
            for name, other in self._newest.items():
                if name != sight.camera.name and abs(sight.stamp_ns - other.stamp_ns) <= LONGEST_APART_NS:
                    self._compare(sight, other, size)
        if sights:
            self.left_out = {name: words for name in self._newest if (words := self._why_left_out(name))}

    def note(self, frames: Sequence[FrameResult]) -> None:
        """Note how far the accepted bodies are from the keypoints of each camera."""
        for frame in frames:
            estimate = frame.estimate
            if not frame.accepted or estimate is None or estimate.pose is None:
                continue
            for one in frame.images:
                apart = norm(project(one.camera.into_camera(estimate.pose.landmarks)) - one.points)
                if (known := np.isfinite(apart)).any():
                    kept = self.residuals.setdefault(one.camera.name, deque(maxlen=RESIDUALS))
                    kept.append(one.lens.focal * float(np.median(apart[known])))

    def _compare(self, one: Sight, other: Sight, size: SizeCheck) -> None:
        pair = self._pairs.setdefault(frozenset((one.camera.name, other.camera.name)), _Pair())
        if abs(one.stamp_ns - pair.newest_ns) < PERIOD_NS:
            return
        places = triangulated(one, other)
        cost, same = compared(one, other, size, places), _same_keypoints(one, other)
        if cost is None and not same:
            return
        pair.newest_ns = one.stamp_ns
        pair.same.append(same)
        pair.costs.append(np.inf if cost is None or same else cost)

    def _pair(self, one: str, other: str) -> _Pair:
        return self._pairs.get(frozenset((one, other)), _Pair())

    def _why_left_out(self, name: str) -> str:
        """Return why a camera is wrong, as others that fit each other show, in words; empty if they do not."""
        others = [other for other in self._newest if self._pair(name, other).cost is not None]
        fitting = [pair for pair in combinations(others, 2) if self._pair(*pair).is_right]
        twin = next((other for other in others if self._pair(name, other).is_same), None)
        if twin is not None:  # one of both is wrong
            fitting = [pair for pair in fitting if twin in pair and self._fits_worse(name, *pair)]
        if not fitting or (twin is None and not all(self._pair(name, other).is_wrong for other in others)):
            return ""
        first, second = fitting[0]
        hint = CHECK if twin is None else f"they are those of '{twin}': check its topics"
        return (
            f"camera '{name}' is not used: its keypoints do not fit those of '{first}' and '{second}', which fit each "
            f"other; {hint}"
        )

    def _fits_worse(self, name: str, one: str, other: str) -> bool:
        """Whether a camera fits neither of two others as well as they fit each other."""
        cost, worse = self._pair(one, other).cost, 1.0 if name in self.left_out else WORSE
        costs = [self._pair(name, third).cost for third in (one, other)]
        return cost is not None and all(own is None or own > worse * cost for own in costs)

    def same_keypoints(self) -> Iterator[str]:
        """Yield which cameras have the same keypoints if it cannot be told which one is wrong, in words."""
        for names, pair in self._pairs.items():
            one, other = sorted(names)
            if pair.is_same and not names & self.left_out.keys():
                yield (
                    f"cameras '{one}' and '{other}' have the same keypoints: check that each detector has a camera of "
                    "its own"
                )


def _same_keypoints(one: Sight, other: Sight) -> bool:
    if one.seen.pixels is None or other.seen.pixels is None:
        return False
    apart = np.linalg.norm(one.seen.pixels - other.seen.pixels, axis=1)
    known = apart[np.isfinite(apart)]
    return len(known) > 0 and float(np.median(known)) < SAME_PX
