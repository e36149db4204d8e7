"""The hands of one person and their gestures, for ~/hands."""

from __future__ import annotations

import numpy as np

from lassokin_ros.core.body.roles import SIDES
from lassokin_ros.core.body.rotations import to_quaternion
from lassokin_ros.core.output.hand_points import HandPoints, HandReading
from lassokin_ros.gestures import GESTURES, GestureWatch, gesture_probabilities
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.outputs.people_messages import id_of
from msg_adapters.output_messages.hand_cloud import HandReport
from msg_adapters.output_messages.people import number_of

LEAST_OBSERVED = 0.5
"""Share of a hand's points that keypoints must show for a gesture to be recognised."""


class Hands:
    """Reads the hands of one person in the order of the frames."""

    def __init__(self, points: HandPoints) -> None:
        """points: of the person's skeleton and layout."""
        self._points, self._watches = points, [GestureWatch() for _ in points.sides]

    def report(self, frame: FrameResult) -> list[HandReport]:
        """Return what ~/hands says about the person of an accepted frame."""
        estimate = frame.estimate
        assert estimate is not None and estimate.pose is not None and estimate.visible is not None
        hands = self._points.read(estimate.pose, estimate.visible, frame.uncertainty)
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
                *_gesture(hand, watch, estimate.stamp, estimate.up),
            )
            for hand, watch in zip(hands, self._watches)
        ]


def _gesture(hand: HandReading, watch: GestureWatch, stamp: float, up: np.ndarray | None) -> tuple[int, float]:
    """Return number and confidence of the gesture. stamp: s. up: (3,) the vertical in the frame of the skeleton."""
    if hand.observed.mean() < LEAST_OBSERVED:
        return 0, 0.0
    name, confidence = watch.update(stamp, gesture_probabilities(hand.points @ hand.axes.T, up))
    return GESTURES.index(name), confidence
