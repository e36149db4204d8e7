"""The 21 points of each hand in axes of the hand, with their covariance, and where the hand points.

The axes are those that dex-retargeting makes of three points (retargeting of dexterous hands, Qin et al., AnyTeleop,
2023): the wrist 0 and the knuckles of index finger 5 and middle finger 9. x points from the middle knuckle to the
wrist, y is normal to the palm, and z points from the middle to the index finger. The three points are fixed to the
wrist's joint, so that a hand in its own axes depends on the fingers' joints alone, and so does its covariance.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lassokin_ros.core.body.kinematics import BodyPose, twists
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.roles import SIDES, sided
from lassokin_ros.core.body.rotations import hat
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.kernel import lapack
from lassokin_ros.core.output.uncertainty import JointUncertainty

Levers = Callable[[np.ndarray, np.ndarray], np.ndarray]
WRIST, INDEX_KNUCKLE, INDEX_TIP, MIDDLE_KNUCKLE = 0, 5, 8, 9
"""Of the 21 points: the wrist, then thumb, index, middle, ring and pinky finger, each from the root to the tip."""
SIZE_DEVIATION, PLACE_DEVIATION = 0.04, 0.003
"""Standard deviation of a hand's length, as a share of it, for a given height: adults' hands have 5 % in all (Gordon et
al., 2012 anthropometric survey of U.S. Army personnel), of which the height explains about a third. And m, per axis, of
the place at which a detector sees a point of the hand."""


@dataclass(eq=False)
class HandReading:
    """One hand of a pose.

    side: "left" or "right". wrist: (3,) m, and axes: (3, 3), its columns are the hand's axes x, y, z, both in the frame
    of the skeleton. points: (21, 3) m from the wrist, along the hand's axes; covariance: (21, 3, 3) m^2 in them.
    observed: (21,) bool, whether a keypoint of this image shows the point; the prior places the others.
    ray: (3,) unit vector in the frame of the skeleton, where the hand would point: from the middle of the eyes through
    the tip of the index finger, where people hold it in front of the target; along the finger if the layout has no
    eyes. ray_deviation: rad, standard deviation of its direction, across in each of two directions.
    """

    side: str
    wrist: np.ndarray
    axes: np.ndarray
    points: np.ndarray
    covariance: np.ndarray
    observed: np.ndarray
    ray: np.ndarray
    ray_deviation: float


def hand_axes(points: np.ndarray) -> np.ndarray:
    """Return the axes (..., 3, 3) of hands, x, y, z as columns. points: (..., 21, 3) in any frame, in any unit."""
    wrist, index, middle = (points[..., place, :] for place in (WRIST, INDEX_KNUCKLE, MIDDLE_KNUCKLE))
    x = _unit(wrist - middle)
    aside = index - middle
    z = _unit(aside - (aside * x).sum(axis=-1, keepdims=True) * x)
    return np.stack([x, np.cross(z, x), z], axis=-1)


class HandPoints:
    """Reads the hands of a skeleton's poses. sides: those whose 21 points the layout has."""

    def __init__(self, skeleton: Skeleton, layout: Layout) -> None:
        places = {name: place for place, name in enumerate(layout.names)}
        self.sides = tuple(side for side in SIDES if f"{side}_hand_wrist" in places)
        self.rows = np.array([places[f"{side}_hand_wrist"] + np.arange(21) for side in self.sides], dtype=int)
        """(hands, 21) index of each hand's points among the landmarks."""
        self._eyes = [places[eye] for eye in sided("eye") if eye in places]
        self._tips = [layout.joints[rows[INDEX_TIP]] for rows in self.rows]
        self._moved = skeleton.ancestors[layout.joints]  # (l, n), joint j moves landmark l
        below = skeleton.ancestors & ~np.eye(skeleton.joint_count, dtype=bool)
        #: (n,) bool for each hand, the joints of its fingers.
        self._fingers = [below[:, layout.joints[rows[WRIST]]] for rows in self.rows]

    def read(self, pose: BodyPose, visible: np.ndarray, uncertainty: JointUncertainty) -> list[HandReading]:
        """Return the hands. visible: (l,) bool, the keypoints of the frame that have a weight, `Estimate.visible`."""
        live = uncertainty.model.live
        twist = twists(pose, pose.orientations).take(live, axis=0).T

        def levers(rows: np.ndarray, moved: np.ndarray) -> np.ndarray:
            """(k, 3, live) m/rad, derivative of landmarks by the live degrees of freedom of the joints `moved`."""
            turned = hat(pose.positions[0] - pose.landmarks[rows]) @ twist[:3] + twist[3:]
            return np.asarray(turned * moved[:, None, live // 3])

        return [self._read(hand, pose, visible, uncertainty, levers) for hand in range(len(self.sides))]

    def _read(
        self, hand: int, pose: BodyPose, visible: np.ndarray, uncertainty: JointUncertainty, levers: Levers
    ) -> HandReading:
        rows = self.rows[hand]
        places = pose.landmarks[rows]
        axes, wrist = hand_axes(places), places[WRIST]
        points = (places - wrist) @ axes
        lever = levers(rows, self._moved[rows] & self._fingers[hand])
        covariance = axes.T @ _covariance(uncertainty, lever) @ axes
        covariance += SIZE_DEVIATION**2 * points[:, :, None] * points[:, None, :]
        covariance += PLACE_DEVIATION**2 * np.eye(3)
        covariance[WRIST] = 0.0
        ray = self._ray(hand, pose, uncertainty, levers)
        return HandReading(self.sides[hand], wrist, axes, points, covariance, visible[rows], *ray)

    def _ray(
        self, hand: int, pose: BodyPose, uncertainty: JointUncertainty, levers: Levers
    ) -> tuple[np.ndarray, float]:
        """Return where a hand points, and its deviation, rad."""
        rows = self.rows[hand]
        ends = np.array([*(self._eyes or [rows[INDEX_KNUCKLE]]), rows[INDEX_TIP]])
        lever = levers(ends, self._moved[ends])
        apart = pose.landmarks[ends[-1]] - pose.landmarks[ends[:-1]].mean(axis=0)
        change = lever[-1:] - lever[:-1].mean(axis=0)
        covariance = uncertainty.factor[self._tips[hand]] ** 2 * _covariance(uncertainty, change)[0]
        length = max(float(np.linalg.norm(apart)), 1e-6)
        ray = apart / length
        across = float(np.trace(covariance) - ray @ covariance @ ray) / 2 + 2 * PLACE_DEVIATION**2
        return ray, float(np.sqrt(max(across, 0.0)) / length)


def _covariance(uncertainty: JointUncertainty, levers: np.ndarray) -> np.ndarray:
    """Return (k, 3, 3) m^2 of points by their levers (k, 3, live), without a factor."""
    count = levers.shape[-1]
    seen, _ = lapack.dtrtrs(uncertainty.lower, levers.reshape(-1, count).T, lower=1)
    seen = seen.T.reshape(levers.shape)
    return np.asarray(seen @ seen.swapaxes(1, 2))


def _unit(vectors: np.ndarray) -> np.ndarray:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12))
