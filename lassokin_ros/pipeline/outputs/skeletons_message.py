"""The joints of all people in one message per image, for ~/skeletons."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.outputs.people_messages import Image, id_of
from msg_adapters.backends import Backend
from msg_adapters.output_messages.clouds import JointsReport, SkeletonsCloudBuilder
from msg_adapters.output_messages.people import number_of


class SkeletonsMessage:
    """Makes one message per image from the accepted frames of the image. People without one are not in it."""

    def __init__(self, backend: Backend, joint_count: int, serialised: bool = False) -> None:
        """serialised: return serialised messages where that is faster."""
        self._builder = SkeletonsCloudBuilder(backend, joint_count, serialised)

    def build(self, image: Image, frames: Sequence[FrameResult]) -> Any:
        """Return the message. image: stamp in ns and frame_id of the keypoints; frames: the results of the image."""
        return self._builder.fill(*image, [joints_report(frame) for frame in frames if frame.accepted])


def joints_report(frame: FrameResult) -> JointsReport:
    """Return what ~/skeleton and ~/skeletons say about the person of an accepted frame."""
    assert frame.estimate is not None and frame.estimate.pose is not None
    still, up = frame.estimate.still, frame.estimate.up
    assert still is not None and up is not None
    return JointsReport(
        number_of(id_of(frame)),
        frame.estimate.pose.positions,
        frame.joint_velocities,
        frame.uncertainty.absolute.joints,
        frame.observed,
        frame.contacts,
        still,
        frame.uncertainty.rotation_deviation,
        frame.uncertainty.deviation,
        frame.quaternions[:-1],
        up,
    )
