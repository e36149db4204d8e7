"""Check of a given height against measured depth, several cameras, or feet on a known floor.

If the given height is wrong, the pose and the bone lengths adapt to the depths, but not the limbs between two measured
landmarks: their lengths in 3D, d_i (u_i, 1) - d_j (u_j, 1), are compared with those of the given skeleton, and so are
limbs that several cameras triangulate. With one camera above a known floor, it is the size with which the feet stand on
it (`height.floor_size`). The check does not change the tracker's poses, but their stated uncertainty.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from lassokin_ros.core.body.kinematics import Kinematics
from lassokin_ros.core.body.roles import sided
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.image.measurement import Measurement
from lassokin_ros.core.learned.height import CORRELATED_S
from lassokin_ros.core.observation import has_passed

SHORTEST = 0.08
"""As a fraction of the height: shortest limb that is used."""
FEWEST = 20
"""Frames until there is a result, the median over the last 100."""
LARGEST_COUNT = 100
"""Frames of which the limbs are kept. The result is the median over all of them."""
LARGEST_RATIO = 1.6
"""Ratio of a limb from which on, or from the inverse, one of its ends is considered to be on an occluder."""
LIMIT = 0.12
"""Logarithm of the ratio from which on the given height is considered wrong. With the right height, 3 cm of noise and a
tenth of the depths on an occluder, it is 0.03 +- 0.04, and at most 0.11 (43 clips of 21 people who are not in the
tests)."""


class SizeCheck:
    """Finds the ratio of measured and given lengths of one person."""

    def __init__(self, kinematics: Kinematics) -> None:
        """kinematics: with the given skeleton."""
        self._kinematics = kinematics
        self.use(kinematics.skeleton)

    def use(self, given: Skeleton) -> None:
        """Use another given skeleton with the same tree, and forget the person."""
        layout = self._kinematics.layout.scaled(given.height / self._kinematics.skeleton.height)
        joints, rest = layout.joints, given.rest_positions[layout.joints] + layout.offsets
        # Pairs of landmarks: one of a joint, one of a child of that joint.
        limbs = np.argwhere(given.parents[joints] == joints[:, None])
        limbs = limbs[np.linalg.norm(rest[limbs[:, 0]] - rest[limbs[:, 1]], axis=1) > SHORTEST * given.height]
        sides = [pair for pair in zip(sided("shoulder"), sided("hip")) if set(pair) <= set(given.joint_names)]
        trunk = [np.argwhere(np.outer(*(joints == given.index(name) for name in side))) for side in sides]
        self._limbs, self._ends = limbs.T, np.concatenate([limbs, *trunk])
        self._lengths = np.linalg.norm(rest[self._ends[:, 0]] - rest[self._ends[:, 1]], axis=1)
        self.reset()

    def reset(self) -> None:
        """Forget the person."""
        self._newest = -math.inf
        self._ratios: deque[np.ndarray] = deque(maxlen=LARGEST_COUNT)

    def is_due(self, stamp: float) -> bool:
        """Return whether a frame at a stamp, s, is used."""
        return has_passed(stamp - self._newest, CORRELATED_S)

    def add(self, stamp: float, ratios: np.ndarray) -> None:
        """Use the ratios (k,) of measured and given lengths of a frame. stamp: s."""
        if len(ratios) and self.is_due(stamp):
            self._newest = stamp
            self._ratios.append(ratios)

    @property
    def ratio(self) -> float:
        """Measured size / given size; 1 until enough frames were used."""
        return float(np.median(np.concatenate(self._ratios))) if len(self._ratios) >= FEWEST else 1.0

    @property
    def wrong(self) -> bool:
        """True if the given height is probably wrong."""
        return abs(math.log(self.ratio)) > LIMIT

    def ratios(self, places: np.ndarray, usable: np.ndarray) -> np.ndarray:
        """Ratios of the limbs' measured and given lengths, of all bodies. places: (..., l, 3) m; usable: (..., l)."""
        above, below = self._limbs
        measured = np.linalg.norm(places[..., above, :] - places[..., below, :], axis=-1)
        found = (measured / self._lengths[: len(above)])[usable[..., above] & usable[..., below]]
        return np.asarray(found[(found > 1 / LARGEST_RATIO) & (found < LARGEST_RATIO)])

    def lengths(self, places: np.ndarray, usable: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Measured and given lengths (k,) m of the limbs and of both sides of the trunk, without implausible ones.

        places: (l, 3) m; usable: (l,).
        """
        seen = usable[self._ends].all(axis=1)
        a, b = places[self._ends[seen]].swapaxes(0, 1)
        measured, given = np.linalg.norm(a - b, axis=1), self._lengths[seen]
        plausible = (measured < LARGEST_RATIO * given) & (given < LARGEST_RATIO * measured)
        return measured[plausible], given[plausible]

    def limb_count(self, usable: np.ndarray) -> int:
        """Number of limbs between usable landmarks (..., l), of all bodies."""
        return int(np.count_nonzero(usable[..., self._limbs].all(axis=-2)))

    def update(self, measurement: Measurement) -> None:
        """Use the measured depths of a tracked frame."""
        if measurement.depth is None or measurement.depth_weights is None or measurement.repeated:
            return
        if not self.is_due(measurement.stamp):
            return
        usable = (measurement.depth_weights > 0) & measurement.visible & (measurement.weights > 0)
        places = measurement.depth[:, None] * np.column_stack([measurement.points, np.ones(len(usable))])
        self.add(measurement.stamp, self.ratios(places, usable))
