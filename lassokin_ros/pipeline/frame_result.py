"""Result of one keypoint message for one person."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lassokin_ros.core.body.rotations import to_quaternion
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.estimate import Estimate
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.observation import HERE, CameraPose, Observation
from lassokin_ros.core.output.uncertainty import JointUncertainty
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.doubt.doubt import Doubt
from lassokin_ros.doubt.monitor import Judgement, Pending
from lassokin_ros.pipeline.camera.lens import Lens
from lassokin_ros.pipeline.people.joint_angles import Angles

BODY_FROM_ROOT = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
"""Axes of the frame `body` (REP-103: x front, y left, z up), as columns in the root joint's frame (x left, y up,
z front)."""


@dataclass(eq=False)
class ImageOfPerson:
    """A person in the image of a camera.

    camera: which one, and where it is in the frame of the skeleton. detected: (l, 2) px, the landmarks from the
    detector, NaN = missing; None without landmarks. points: (l, 2), their normalised image coordinates.
    """

    camera: CameraPose
    lens: Lens
    detected: np.ndarray | None
    points: np.ndarray

    def project(self, points: np.ndarray) -> np.ndarray:
        """Project points (k, 3) m in the frame of the skeleton to pixels (k, 2)."""
        return self.lens.distort(project(self.camera.into_camera(points)))


@dataclass(eq=False)
class FrameResult:
    """Result of one keypoint message for one person, or of a message that was refused as a whole.

    With `smoothing_lag` an accepted result is returned later than its message. It still refers to that message.

    Attributes
    ----------
    stamp_ns: ns, the message's stamp, or its arrival time if it has no stamp.
    frame_id: the frame of the skeleton: `fixed_frame`, or the message's frame, or the camera's if it has none.
    estimate: the tracker's result. None if the message was refused before tracking.
    rejection: None for an accepted result, else a short key for counting. `detail` gives the reason in words.
    person: the id of the person. Empty if one person is followed.
    images: those that were processed together; empty if the message was refused before tracking.
    observations: what the tracker was given. Empty if the message was refused before tracking.
    skeleton: the skeleton with the lengths used for this result. None if the message was refused before tracking.
    earlier: s since the result before, and its joint positions (n, 3) m; see `joint_velocities`. None after
    initialisation, and for a step of the stamps below 1 ms.
    velocity: (3,) m/s, velocity of the pelvis, and its covariance (3, 3) m^2/s^2, see `walking_velocity.py`. None if
    rejected.
    tracker: the person's, for what is computed on request: `uncertainty` and `observed`. None if rejected.
    angles: those of the joints, see `positions`. None if rejected.
    label: the id in the messages about all people, if it is not `person`.
    detector_id: the person's number from the detector; -1 if it has none that lasts.
    guessed: True if the person was found again by place after an absence, and may be somebody else.
    held_s: s, by stamps, how long the result waited for later messages (`smoothing_lag`).
    pending: the doubt about the pose, see `judgement`. None if rejected.
    doubts: why the place or the size of the person is doubted, in words; empty if they are not.
    """

    stamp_ns: int
    frame_id: str
    estimate: Estimate | None = None
    rejection: str | None = None
    detail: str = ""
    person: str = ""
    images: Sequence[ImageOfPerson] = ()
    observations: Sequence[Observation] = ()
    skeleton: Skeleton | None = None
    earlier: tuple[float, np.ndarray] | None = None
    velocity: np.ndarray | None = None
    velocity_covariance: np.ndarray | None = None
    tracker: Tracker | None = None
    angles: Angles | None = None
    label: str = ""
    detector_id: int = -1
    guessed: bool = False
    held_s: float = 0.0
    pending: Pending | None = None
    doubts: tuple[str, ...] = ()

    @property
    def accepted(self) -> bool:
        """True if the result has outputs to publish."""
        return self.rejection is None

    @property
    def camera(self) -> CameraPose:
        """Which camera took the first image, and where it is in the frame of the skeleton."""
        return self.images[0].camera if self.images else HERE

    @property
    def lens(self) -> Lens | None:
        """The lens of the first image; None if the message was refused before tracking."""
        return self.images[0].lens if self.images else None

    @property
    def detected(self) -> np.ndarray | None:
        """(l, 2) px: the landmarks from the detector in the first image, NaN = missing. None without landmarks."""
        return self.images[0].detected if self.images else None

    @property
    def points(self) -> np.ndarray | None:
        """(l, 2) normalised image coordinates of `detected`. None if the message was refused before tracking."""
        return self.images[0].points if self.images else None

    @property
    def positions(self) -> np.ndarray | None:
        """(3 + 3 n,) in the order of urdf.joint_names, m and rad. None if rejected."""
        return None if self.angles is None else self.angles.read[0]

    @property
    def velocities(self) -> np.ndarray | None:
        """(3 + 3 n,) in the same order, m/s and rad/s. None if rejected."""
        return None if self.angles is None else self.angles.read[1]

    @cached_property
    def uncertainty(self) -> JointUncertainty:
        """Joint uncertainty, computed at the first access. Raises ValueError if the result was rejected."""
        if self.tracker is None or self.estimate is None:
            raise ValueError("this result was rejected; only an accepted result has an uncertainty")
        return self.tracker.uncertainty(self.estimate)

    @property
    def judgement(self) -> Judgement:
        """The doubt in its context, made at the first access. Without a doubt if rejected."""
        return Judgement() if self.pending is None else self.pending.read()

    @property
    def doubt(self) -> Doubt:
        """The doubt about this frame. Without a doubt if rejected."""
        return self.judgement.doubt

    @property
    def doubtful(self) -> tuple[str, ...]:
        """Why the frames of the last moments are doubted, see `Judgement`, and the place or the size."""
        return self.doubts + self.judgement.reasons

    @property
    def doubtful_s(self) -> float:
        """s for which the person's pose has been doubtful without a break; NaN if it is not."""
        return self.judgement.seconds

    @property
    def likely_wrong(self) -> float:
        """Probability, 0 to 1, that the mean error of the joints exceeds 100 mm. Raises ValueError if rejected.

        It is that of the doubt's figures, and without the depth network that of the uncertainty.
        """
        stated = self.doubt.probability
        return stated if math.isfinite(stated) else self.uncertainty.failure_probability

    @cached_property
    def quaternions(self) -> np.ndarray:
        """(n + 1, 4), x, y, z, w: orientations of the joints and, last, of the body (x front, y left, z up).

        The frame of the skeleton is the reference. Needs an accepted result.
        """
        assert self.estimate is not None and self.estimate.pose is not None
        orientations = self.estimate.pose.orientations
        body = orientations[:1] @ BODY_FROM_ROOT
        return to_quaternion(np.concatenate([orientations, body]))

    @property
    def joint_velocities(self) -> np.ndarray:
        """(n, 3) m/s, differences of joint positions over stamps, 0 after initialisation. Needs an accepted result."""
        assert self.estimate is not None and self.estimate.pose is not None
        positions = self.estimate.pose.positions
        if self.earlier is None:
            return np.zeros_like(positions)
        seconds, before = self.earlier
        velocities: np.ndarray = (positions - before) / seconds
        return velocities

    @cached_property
    def observed(self) -> np.ndarray:
        """(n,) bool, the joints that the keypoints observe. Raises ValueError if the result was rejected."""
        if self.tracker is None or self.estimate is None:
            raise ValueError("this result was rejected; only an accepted result has observed joints")
        return self.tracker.observed(self.estimate)

    @property
    def contacts(self) -> np.ndarray:
        """(n,) bool, the ankles of feet that stand still on the floor. Raises ValueError if the result was rejected."""
        if self.estimate is None or self.estimate.contacts is None:
            raise ValueError("this result was rejected; only an accepted result has contacts")
        return self.estimate.contacts

    @property
    def reprojected(self) -> np.ndarray | None:
        """(l, 2) px, the landmarks of the estimated pose projected into the image. None if the result was rejected."""
        if self.estimate is None or self.estimate.pose is None or not self.images:
            return None
        return self.images[0].project(self.estimate.pose.landmarks)


def repeated_s(frames: Sequence[FrameResult]) -> float:
    """Return how long, in s, the keypoints of all people have been repeated; 0 if any are new or nobody is tracked."""
    accepted = [frame.estimate.repeated for frame in frames if frame.accepted and frame.estimate is not None]
    return min(accepted, default=0.0)
