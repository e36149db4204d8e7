"""Result of one keypoint message for one person."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np

from lassokin_ros.core.body.rotations import to_quaternion
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.estimate import Estimate
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.observation import HERE, CameraPose, Observation
from lassokin_ros.core.output.uncertainty import JointUncertainty
from lassokin_ros.core.record import record
from lassokin_ros.doubt.doubt import Doubt
from lassokin_ros.doubt.monitor import Judgement
from lassokin_ros.pipeline.camera.lens import Lens

BODY_FROM_ROOT = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
"""Axes of the frame `body` (REP-103: x front, y left, z up), as columns in the root joint's frame (x left, y up,
z front)."""


@record
class ImageOfPerson:
    """A person in the image of a camera: where the camera is, its lens, the landmarks as in FrameResult."""

    camera: CameraPose
    lens: Lens
    detected: np.ndarray | None
    points: np.ndarray

    def project(self, points: np.ndarray) -> np.ndarray:
        """Project points (k, 3) m in the frame of the skeleton to pixels (k, 2)."""
        return self.lens.distort(project(self.camera.into_camera(points)))


@record
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
    detected: (l, 2) px, the landmarks from the detector, NaN = missing. None without landmarks.
    points: (l, 2) normalised image coordinates of `detected`. None if the message was refused before tracking.
    lens: the lens of the image. None if the message was refused before tracking.
    camera: which camera took the image, and where it is in the frame of the skeleton.
    others: the images of further cameras that were processed together with this one.
    observations: what the tracker was given. Empty if the message was refused before tracking.
    skeleton: the skeleton with the lengths used for this result. None if the message was refused before tracking.
    earlier: s since the result before, and its joint positions (n, 3) m; see `joint_velocities`. None after
    initialisation, and for a step of the stamps below 1 ms.
    velocity: (3,) m/s, velocity of the pelvis, and its covariance (3, 3) m^2/s^2, see `walking_velocity.py`. None if
    rejected.
    measure: computes the joint uncertainty, see `uncertainty`.
    observe: computes which joints are observed, see `observed`.
    joint_states: computes `positions` and `velocities`.
    label: the id in the messages about all people, if it is not `person`.
    detector_id: the person's number from the detector; -1 if it has none that lasts.
    guessed: True if the person was found again by place after an absence, and may be somebody else.
    held_s: s, by stamps, how long the result waited for later messages (`smoothing_lag`).
    judge: gives the doubt about the pose, see `LiveDoubts.add`; none if rejected.
    doubts: why the place or the size of the person is doubted, in words; empty if they are not.
    """

    stamp_ns: int
    frame_id: str
    estimate: Estimate | None = None
    rejection: str | None = None
    detail: str = ""
    person: str = ""
    detected: np.ndarray | None = None
    points: np.ndarray | None = None
    lens: Lens | None = None
    camera: CameraPose = HERE
    others: Sequence[ImageOfPerson] = ()
    observations: Sequence[Observation] = ()
    skeleton: Skeleton | None = None
    earlier: tuple[float, np.ndarray] | None = None
    velocity: np.ndarray | None = None
    velocity_covariance: np.ndarray | None = None
    measure: Callable[[Estimate], JointUncertainty] | None = None
    observe: Callable[[Estimate], np.ndarray] | None = None
    joint_states: Callable[[], tuple[np.ndarray, np.ndarray]] | None = None
    label: str = ""
    detector_id: int = -1
    guessed: bool = False
    held_s: float = 0.0
    judge: Callable[[], Judgement] = Judgement
    doubts: tuple[str, ...] = ()

    @property
    def accepted(self) -> bool:
        """True if the result has outputs to publish."""
        return self.rejection is None

    @property
    def images(self) -> tuple[ImageOfPerson, ...]:
        """The images of all cameras that were processed together. Empty if refused before tracking."""
        if self.lens is None or self.points is None:
            return ()
        return (ImageOfPerson(self.camera, self.lens, self.detected, self.points), *self.others)

    @property
    def positions(self) -> np.ndarray | None:
        """(3 + 3 n,) in the order of urdf.joint_names, m and rad. None if rejected."""
        return self._joint_state[0]

    @property
    def velocities(self) -> np.ndarray | None:
        """(3 + 3 n,) in the same order, m/s and rad/s. None if rejected."""
        return self._joint_state[1]

    @cached_property
    def _joint_state(self) -> tuple[np.ndarray | None, np.ndarray | None]:
        """Computed at the first access. The angles are continuous to the frame that was read last."""
        return (None, None) if self.joint_states is None else self.joint_states()

    @cached_property
    def uncertainty(self) -> JointUncertainty:
        """Joint uncertainty, computed at the first access. Raises ValueError if the result was rejected."""
        if self.measure is None or self.estimate is None:
            raise ValueError("this result was rejected; only an accepted result has an uncertainty")
        return self.measure(self.estimate)

    @property
    def doubt(self) -> Doubt:
        """The doubt about this frame. Without a doubt if rejected."""
        return self.judge().doubt

    @property
    def doubtful(self) -> tuple[str, ...]:
        """Why the frames of the last moments are doubted, see `Judgement`, and the place or the size."""
        return self.doubts + self.judge().reasons

    @property
    def doubtful_s(self) -> float:
        """s for which the person's pose has been doubtful without a break; NaN if it is not."""
        return self.judge().seconds

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
        if self.observe is None or self.estimate is None:
            raise ValueError("this result was rejected; only an accepted result has observed joints")
        return self.observe(self.estimate)

    @property
    def contacts(self) -> np.ndarray:
        """(n,) bool, the ankles of feet that stand still on the floor. Raises ValueError if the result was rejected."""
        if self.estimate is None or self.estimate.contacts is None:
            raise ValueError("this result was rejected; only an accepted result has contacts")
        return self.estimate.contacts

    @property
    def reprojected(self) -> np.ndarray | None:
        """(l, 2) px, the landmarks of the estimated pose projected into the image. None if the result was rejected."""
        if self.estimate is None or self.estimate.pose is None or self.lens is None:
            return None
        return self.in_image(self.estimate.pose.landmarks)

    def in_image(self, points: np.ndarray) -> np.ndarray:
        """Project points (k, 3) m in the frame of the skeleton to pixels (k, 2). The result must be accepted."""
        assert self.lens is not None
        return self.lens.distort(project(self.camera.into_camera(points)))


def repeated_s(frames: Sequence[FrameResult]) -> float:
    """Return how long, in s, the keypoints of all people have been repeated; 0 if any are new or nobody is tracked."""
    accepted = [frame.estimate.repeated for frame in frames if frame.accepted and frame.estimate is not None]
    return min(accepted, default=0.0)
