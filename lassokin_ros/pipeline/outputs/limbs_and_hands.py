"""The limbs of one person for ~/limbs, and the hands with their gestures for ~/hands and REP-155's gesture."""

from __future__ import annotations

import numpy as np

from lassokin_ros.core.body.roles import SIDES
from lassokin_ros.core.body.rotations import to_quaternion
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.output.hand_points import HandPoints
from lassokin_ros.gestures import GESTURES, GestureWatch, gesture_probabilities, points_up
from lassokin_ros.pipeline.frame_result import BODY_FROM_ROOT, FrameResult
from lassokin_ros.pipeline.outputs.scene_messages import id_of
from msg_adapters.output_messages.clouds import REP155_GESTURES, HandReport
from msg_adapters.output_messages.people import number_of

LIMBS = tuple(
    (f"{side}_{end}", f"{side}_{root}")
    for side in ("left", "right")
    for root, ends in (("shoulder", ("elbow", "wrist", "hand")), ("hip", ("knee", "ankle", "foot")))
    for end in ends
)
"""End and root of each entry, by the names of the joints. Joints that a skeleton does not have are left out."""
CHEST = "spine3"
"""Joint whose orientation gives the axes of the arms; the first joint in a skeleton without it. Legs have those of the
first joint, the pelvis."""


class Limbs:
    """Reads the limbs of a skeleton's poses. ends, roots: (k,) indices of joints."""

    def __init__(self, skeleton: Skeleton) -> None:
        names = list(skeleton.joint_names)
        pairs = [(names.index(end), names.index(root)) for end, root in LIMBS if end in names and root in names]
        self.ends, self.roots = [end for end, _ in pairs], [root for _, root in pairs]
        chest = names.index(CHEST) if CHEST in names else 0
        self._axes = [0 if names[root].endswith("hip") else chest for root in self.roots]

    def read(self, frame: FrameResult) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return positions (k, 3) m, their covariance (k, 3, 3) m^2, and which ends are observed (k,) bool.

        The covariance is the sum of those of end and root relative to the pelvis. It is an upper limit while their
        errors have the same sign.
        """
        assert frame.estimate is not None and frame.estimate.pose is not None
        pose, covariance = frame.estimate.pose, frame.uncertainty.covariance
        axes = pose.orientations[self._axes] @ BODY_FROM_ROOT
        apart = pose.positions[self.ends] - pose.positions[self.roots]
        along = np.einsum("kij,ki->kj", axes, apart)
        turned = axes.transpose(0, 2, 1) @ (covariance[self.ends] + covariance[self.roots]) @ axes
        return along, turned, frame.observed[self.ends]


LEAST_OBSERVED = 0.5
"""Share of a hand's points that keypoints must show for a gesture to be recognised."""


class Hands:
    """Reads the hands of one person in the order of the frames."""

    def __init__(self, points: HandPoints) -> None:
        """points: of the person's skeleton and layout."""
        self._points, self._watches = points, [GestureWatch() for _ in points.sides]
        self._frame: FrameResult | None = None  # of the gestures
        self._gestures: list[tuple[str, float] | None] = []

    def report(self, frame: FrameResult) -> list[HandReport]:
        """Return what ~/hands says about the person of an accepted frame."""
        estimate = frame.estimate
        assert estimate is not None and estimate.pose is not None and estimate.visible is not None
        hands = self._points.read(estimate.pose, estimate.visible, frame.uncertainty)
        said = [gesture or (GESTURES[0], 0.0) for gesture in self._update(frame)]
        return [
            HandReport(
                SIDES.index(hand.side),
                number_of(id_of(frame)),
                hand.points,
                hand.covariance,
                hand.observed,
                hand.wrist,
                to_quaternion(hand.axes),
                hand.ray,
                hand.ray_deviation,
                GESTURES.index(name),
                confidence,
            )
            for hand, (name, confidence) in zip(hands, said)
        ]

    def rep155_gestures(self, frame: FrameResult) -> list[tuple[int, int]]:
        """Return number of hri_msgs/Gesture and side (0 left, 1 right) of each hand that is seen in an accepted frame.

        It has pointing up only: a hand that points elsewhere is 0, another gesture.
        """
        assert frame.estimate is not None and frame.estimate.pose is not None
        said, places = [], frame.estimate.pose.landmarks[self._points.rows]
        for side, gesture, points in zip(self._points.sides, self._update(frame), places):
            if gesture is not None:
                elsewhere = gesture[0] == "pointing" and not points_up(points, frame.estimate.up)
                number = 0 if elsewhere else REP155_GESTURES.get(gesture[0], 0)
                said.append((number, SIDES.index(side)))
        return said

    def _update(self, frame: FrameResult) -> list[tuple[str, float] | None]:
        """Name and confidence of each hand's gesture, None for one that is hardly seen; once for each frame."""
        estimate = frame.estimate
        assert estimate is not None and estimate.pose is not None and estimate.visible is not None
        if frame is not self._frame:
            seen = estimate.visible[self._points.rows].mean(axis=1) >= LEAST_OBSERVED
            likely = gesture_probabilities(estimate.pose.landmarks[self._points.rows], estimate.up)
            hands = zip(self._watches, likely, seen)
            self._gestures = [watch.update(estimate.stamp, own) if there else None for watch, own, there in hands]
            self._frame = frame
        return self._gestures
