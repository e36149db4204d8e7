"""The log of a replay for the page: one row per message, and one row per message and person."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from lassokin_ros.common.array_spool import ArraySpool, Record
from lassokin_ros.core.body.rotations import logarithm
from lassokin_ros.doubt.doubt import Doubt
from lassokin_ros.pipeline.frame_result import FrameResult, ImageOfPerson

STAMP_REASONS = ("old_stamp", "stamp_jump", "bad_stamp")
LONGEST_AHEAD_S = 10.0
"""s: a stamp that advances by this much more than the recording time is a jump."""


@dataclass(frozen=True, slots=True)
class MessageRow:
    """One keypoint message.

    time: s since the first message, by stamps. delay: s from stamp to recording. seconds: tracking time, s.
    people: number of published skeletons. stamp_ns: ns. rejection: key of the reason, if the message was rejected.
    """

    time: float
    delay: float
    seconds: float
    people: int
    stamp_ns: int
    rejection: str | None = None


def _stored(name: str) -> property:
    """A property that reads an array of a row from the file; None if the row has none of this name."""
    return property(lambda row: row.spool.read(row.record).get(name))


@dataclass(frozen=True, eq=False, slots=True)
class PersonRow:
    """One person in one message. Its arrays are in a file; they are None for a rejected frame.

    time: s. rejection: key of the reason. depth: m, of the pelvis before the camera. detected: (l, 2) px, None
    without keypoints. reprojected: (l, 2) px.
    outline: (n, 2) px, joints in the image. These three are of the first camera; `in_view` returns those of others.
    positions: (n, 3) m, camera frame. angles: (n, 3) deg, as in `joint_states`. bends: (n,) deg, rotation angle of each
    joint. lengths: (n,) m, length of the bone that ends at each joint. deviations: (n,) m, see `JointUncertainty`.
    visible: (l,) bool, landmarks that count. observed: (n,) bool, see `ObservedJoints`. contacts: (n,) bool, ankles of
    feet that stand still. doubt: None for a rejected frame.
    """

    time: float
    rejection: str | None
    spool: ArraySpool
    record: Record
    reprojection_px: float = np.nan
    relative_gap: float = np.nan
    kkt: float = np.nan
    support: float = np.nan
    initialised: bool = False
    doubt: Doubt | None = None
    depth: float = np.nan

    detected = _stored("detected")
    reprojected = _stored("reprojected")
    outline = _stored("outline")
    positions = _stored("positions")
    angles = _stored("angles")
    bends = _stored("bends")
    lengths = _stored("lengths")
    deviations = _stored("deviations")
    visible = _stored("visible")
    observed = _stored("observed")
    contacts = _stored("contacts")

    def in_view(self, name: str, number: int) -> np.ndarray | None:
        """Return `detected`, `reprojected` or `outline` in the image of a camera, by its number."""
        return self.spool.read(self.record).get(_of_view(name, number))

    @property
    def mean_deviation_mm(self) -> float:
        """Mean over the joints without the root, mm."""
        deviations = self.deviations
        return np.nan if deviations is None else 1e3 * float(deviations[1:].mean())

    @property
    def worst_deviation_mm(self) -> float:
        """Largest deviation of a joint, mm."""
        deviations = self.deviations
        return np.nan if deviations is None else 1e3 * float(deviations.max())


@dataclass(frozen=True)
class Jump:
    """A jump of the stamps. time: s, on the page's axis. ahead: s, negative for a jump back."""

    time: float
    ahead: float


@dataclass
class ReplayLog:
    """The log. It grows by about 0.4 kB per message and person, and a temporary file by 4 kB.

    people: rows by person id, "" in single-person mode. details: explanation of the first rejected message, by reason.
    cameras: their names. level: (3, 3) from the frame of the skeleton to the axes of the page, those of a camera; None
    if they are the same.
    """

    messages: list[MessageRow] = field(default_factory=list)
    people: dict[str, list[PersonRow]] = field(default_factory=dict)
    details: dict[str, str] = field(default_factory=dict)
    jumps: list[Jump] = field(default_factory=list)
    first_stamp_ns: int | None = None
    cameras: Sequence[str] = ("",)
    level: np.ndarray | None = None
    _last: tuple[float, int, int] | None = None
    _spool: ArraySpool = field(default_factory=ArraySpool)
    _images: dict[str, ImageOfPerson] = field(default_factory=dict)

    def add(self, frames: Sequence[FrameResult], time_ns: int, seconds: float) -> None:
        """Add the frames of one keypoint message, in the order of the stamps.

        time_ns: recording time. seconds: tracking time.
        """
        stamp_ns = frames[0].stamp_ns if frames else time_ns
        refused = next((f.rejection for f in frames if not f.accepted), None)
        time = self._clock(stamp_ns, time_ns, refused not in STAMP_REASONS)
        accepted = sum(frame.accepted for frame in frames)
        self.messages.append(MessageRow(time, (time_ns - stamp_ns) * 1e-9, seconds, accepted, stamp_ns, refused))
        for frame in frames:
            if frame.rejection is not None:
                self.details.setdefault(frame.rejection, frame.detail)
            if frame.detected is not None or frame.accepted:
                self.people.setdefault(frame.person, []).append(self._row(frame, time))

    def _row(self, frame: FrameResult, time: float) -> PersonRow:
        now = {image.camera.name: image for image in frame.images}
        self._images |= now  # a camera without an image at this time shows the body from where it was last
        views = [(now.get(name), self._images.get(name)) for name in self.cameras]
        return person_row(frame, time, self._spool, self.level, views)

    def _clock(self, stamp_ns: int, time_ns: int, stamp_valid: bool) -> float:
        """Return the time on the page's axis, s: by stamps, and by recording time where the stamps jump.

        stamp_valid: False if the message was rejected because of its stamp.
        """
        if self._last is None:
            self._last, self.first_stamp_ns = (0.0, stamp_ns, time_ns), stamp_ns
            return 0.0
        time, last_stamp, last_time = self._last
        step, recorded = (stamp_ns - last_stamp) * 1e-9, max((time_ns - last_time) * 1e-9, 0.0)
        if not stamp_valid:
            return time + recorded
        if step < 0 or step > recorded + LONGEST_AHEAD_S:
            self.jumps.append(Jump(time + recorded, step))
            step = recorded
        self._last = time + step, stamp_ns, time_ns
        return time + step


def _of_view(name: str, number: int) -> str:
    """Return the name of an array of a camera."""
    return f"{name} {number}" if number else name


def person_row(
    frame: FrameResult,
    time: float,
    spool: ArraySpool,
    level: np.ndarray | None,
    views: Sequence[tuple[ImageOfPerson | None, ImageOfPerson | None]],
) -> PersonRow:
    """Return the row of a frame; its arrays go to `spool`. level: (3, 3) turns the positions for the page.

    views: the present and the newest image of each camera, None without one.
    """
    estimate = frame.estimate
    detected = {
        _of_view("detected", number): now.detected
        for number, (now, _) in enumerate(views)
        if now is not None and now.detected is not None
    }
    if not frame.accepted or estimate is None or frame.lens is None or frame.positions is None:
        return PersonRow(time, frame.rejection, spool, spool.append(detected))
    assert estimate.pose is not None and estimate.state is not None
    positions = estimate.pose.positions
    arrays = {
        **detected,
        "positions": positions if level is None else positions @ level.T,
        "angles": np.degrees(frame.positions[3:]).reshape(-1, 3),
        "bends": np.degrees(np.linalg.norm(logarithm(estimate.state.rotations), axis=-1)),
        "deviations": frame.uncertainty.deviation,
        "visible": estimate.visible,
        "observed": frame.observed,
        "contacts": frame.contacts,
    }
    for number, (_, newest) in enumerate(views):
        if newest is not None:
            arrays[_of_view("reprojected", number)] = newest.project(estimate.pose.landmarks)
            arrays[_of_view("outline", number)] = newest.project(positions)
    if frame.skeleton is not None:
        arrays["lengths"] = np.linalg.norm(frame.skeleton.offsets, axis=-1)
    depth = float(frame.camera.into_camera(positions[0])[2])
    proof = estimate.certificate
    assert proof is not None
    figures = estimate.reprojection_px, proof.relative_gap, proof.kkt_residual, float(proof.support_size)
    return PersonRow(time, None, spool, spool.append(arrays), *figures, estimate.initialised, frame.doubt, depth)
