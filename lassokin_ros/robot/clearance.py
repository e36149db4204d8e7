"""Soft rows that keep a robot's limbs apart: capsules between its places, with the radii of its file.

A pair that is nearer than MARGIN, or would be nearer than LEAST in AHEAD_S at the present speed, is pushed apart along
the line between its closest points (C. Ericson, Real-Time Collision Detection, 2005, section 5.1.9). The rows are
costs, not constraints: they make no tick infeasible, and a person whose arms are folded is imitated as near as the
weight allows.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from pink import Configuration

from lassokin_ros.robot.model import RobotModel
from lassokin_ros.robot.robot_file import PLACES, SIDES

MARGIN = 0.03
"""m, between two surfaces, from which they are pushed apart."""
LEAST, AHEAD_S = 0.01, 0.03
"""m, s: a limb of 6 rad/s needs 0.06 s to brake; a hold begins at any moment."""
WEIGHT = 30.0
"""1/m; those of the places are 2 to 4."""
_FORE, _THIGH, _SHIN = "forearm", "thigh", "shin"
_ENDS = {_FORE: ("elbow", "wrist"), _THIGH: ("hip", "knee"), _SHIN: ("knee", "ankle")}
_TRUNK = ("trunk", ("base",), ("left_shoulder", "right_shoulder"))
_LIMBS = {(side, part): (part, (f"{side}_{a}",), (f"{side}_{b}",)) for side in SIDES for part, (a, b) in _ENDS.items()}
_PAIRS = (
    *((_LIMBS[side, _FORE], _TRUNK) for side in SIDES),
    *((_LIMBS["left", part], _LIMBS["right", part]) for part in _ENDS),
    *((_LIMBS[side, _FORE], _LIMBS[other, _THIGH]) for side in SIDES for other in SIDES),
)
"""Capsules that may meet: part, and the places whose means are its ends."""


class Clearance:
    """The pairs of capsules of a robot: those of which both parts have a radius in its file."""

    def __init__(self, model: RobotModel) -> None:
        radii = model.robot.radii
        pairs = [pair for pair in _PAIRS if all(part in radii for part, _, _ in pair)]
        self._frames = [model.frames[place] for place in PLACES]
        self._ends = np.zeros((len(pairs), 4, len(PLACES)))  # weights of the places in the ends: a, b; c, d
        for row, (one, other) in enumerate(pairs):
            for end, places in enumerate((*one[1:], *other[1:])):
                self._ends[row, end, [PLACES.index(place) for place in places]] = 1 / len(places)
        self._thickness = np.array([radii[one[0]] + radii[other[0]] for one, other in pairs])
        self.start()

    def gaps(self, configuration: Configuration) -> np.ndarray:
        """Return (p,) m, the distance between the surfaces of each pair; negative if they overlap."""
        return self._closest(configuration)[0]

    def start(self) -> None:
        """Forget the last tick: the robot was placed anew."""
        self._last: np.ndarray | None = None

    def rows(self, configuration: Configuration, period: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the weighted Jacobian (r, nv) and error (r,) of the pairs that are too near.

        period: s since the last call.
        """
        gaps, directions, weights = self._closest(configuration)
        change = np.zeros_like(gaps) if self._last is None else np.minimum(gaps - self._last, 0.0)
        self._last = gaps
        error = np.minimum(gaps - MARGIN, gaps + AHEAD_S / period * change - LEAST)
        near = error < 0
        if not near.any():
            return np.zeros((0, configuration.model.nv)), np.zeros(0)
        model, data, axes = configuration.model, configuration.data, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        jacobians = np.stack([pin.getFrameJacobian(model, data, frame, axes)[:3] for frame in self._frames])
        moved = np.tensordot(weights[near], jacobians, 1)
        return WEIGHT * (directions[near][:, None] @ moved)[:, 0], WEIGHT * error[near]

    def _closest(self, configuration: Configuration) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return gaps (p,) m, unit vectors (p, 3) from the second to the first, and weights (p, 14) of the places.

        The weights give the difference of the two closest points.
        """
        placed = configuration.data.oMf
        at = np.array([placed[frame].translation for frame in self._frames])
        a, b, c, d = (self._ends @ at).swapaxes(0, 1)
        s, t = closest(a, b, c, d)
        shares = np.stack([1 - s, s, t - 1, -t], axis=1)
        weights = (shares[:, None] @ self._ends)[:, 0]
        between = weights @ at
        distances = np.sqrt((between * between).sum(axis=1))
        return distances - self._thickness, between / np.maximum(distances, 1e-9)[:, None], weights


def closest(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return s, t (n,), 0 to 1: a + s (b - a), c + t (d - c) are the closest points of ab and cd, (n, 3) m."""
    lines = np.stack([b - a, d - c, a - c], axis=1)
    products = lines @ lines.swapaxes(1, 2)
    uu, vv, uv = products[:, 0, 0] + 1e-12, products[:, 1, 1] + 1e-12, products[:, 0, 1]
    uw, vw = products[:, 0, 2], products[:, 1, 2]
    s = _share((uv * vw - uw * vv) / np.maximum(uu * vv - uv * uv, 1e-12))
    t = _share((uv * s + vw) / vv)
    return _share((uv * t - uw) / uu), t


def _share(values: np.ndarray) -> np.ndarray:
    return np.minimum(np.maximum(values, 0.0), 1.0)  # faster than clip
