"""What became of one person in one keypoint message."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.estimate import Estimate
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.output.uncertainty import JointUncertainty
from lassokin_ros.pipeline.lens import Lens


@dataclass(frozen=True, eq=False)
class FrameResult:
    """What became of one keypoint message, or of one person in it.

    With `smoothing_lag` an accepted frame comes later than its message; what it says is of that message all the same.

    Attributes
    ----------
    stamp_ns: ns, the message's; its arrival where it has none. frame_id: the message's, the camera's where it has none.
    estimate: the tracker's answer; None when the message did not come so far.
    rejection: None for an accepted frame, else a short key for counting; `detail` says it in words.
    positions, velocities: (3 + 3 n,) in the order of urdf.joint_names, m and rad, m/s and rad/s; None when rejected.
    person: the id under which one of several people is published; empty when one person is followed.
    detected: (l, 2) px, the landmarks as the detector gave them, NaN = missing; None when there were none.
    points: (l, 2) normalised, the same without the lens; None when the message did not come so far.
    lens: what they were seen through; None when the message did not come so far.
    skeleton: the one with whose lengths the frame was tracked; None when the message did not come so far.
    measure: makes the joints' uncertainty, see `uncertainty`.
    held_s: s, by stamps, for which the frame waited for later ones (`smoothing_lag`).
    """

    stamp_ns: int
    frame_id: str
    estimate: Estimate | None = None
    rejection: str | None = None
    detail: str = ""
    positions: np.ndarray | None = None
    velocities: np.ndarray | None = None
    person: str = ""
    detected: np.ndarray | None = None
    points: np.ndarray | None = None
    lens: Lens | None = None
    skeleton: Skeleton | None = None
    measure: Callable[[Estimate], JointUncertainty] | None = None
    held_s: float = 0.0

    @property
    def accepted(self) -> bool:
        """True when there is something to publish."""
        return self.rejection is None

    @cached_property
    def uncertainty(self) -> JointUncertainty:
        """How far off each joint may be, computed when asked first; ValueError when the frame was rejected."""
        if self.measure is None or self.estimate is None:
            raise ValueError("this frame was rejected; only an accepted one has an uncertainty")
        return self.measure(self.estimate)

    @property
    def reprojected(self) -> np.ndarray | None:
        """(l, 2) px, the skeleton's landmarks in the image, through the lens; None when the frame was rejected."""
        if self.estimate is None or self.estimate.pose is None or self.lens is None:
            return None
        return self.in_image(self.estimate.pose.landmarks)

    def in_image(self, points: np.ndarray) -> np.ndarray:
        """(k, 3) m in the camera's frame -> (k, 2) px, through the lens of an accepted frame."""
        assert self.lens is not None
        return self.lens.distort(project(points))


def repeated_s(frames: Sequence[FrameResult]) -> float:
    """s for which everybody's keypoints in a message have been the same; 0 where somebody's are new, or nobody is."""
    accepted = [frame.estimate.repeated for frame in frames if frame.accepted and frame.estimate is not None]
    return min(accepted, default=0.0)
