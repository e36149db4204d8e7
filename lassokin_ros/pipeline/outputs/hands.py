"""The hands of one person, for ~/hands."""

from __future__ import annotations

from lassokin_ros.core.body.roles import SIDES
from lassokin_ros.core.body.rotations import to_quaternion
from lassokin_ros.core.output.hand_points import HandPoints
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.outputs.people_messages import id_of
from msg_adapters.output_messages.hand_cloud import HandReport
from msg_adapters.output_messages.people import number_of


def hands_report(frame: FrameResult, hands: HandPoints) -> list[HandReport]:
    """Return what ~/hands says about the person of an accepted frame."""
    estimate = frame.estimate
    assert estimate is not None and estimate.pose is not None and estimate.visible is not None
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
        )
        for hand in hands.read(estimate.pose, estimate.visible, frame.uncertainty)
    ]
