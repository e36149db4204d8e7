"""The table of a recording's frames, which report and exports read: a row per message, and one per person in it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from lassokin_ros.common.array_spool import ArraySpool, Record
from lassokin_ros.doubt.doubt import Doubt
from lassokin_ros.pipeline.frame_result import FrameResult, ImageOfPerson
from lassokin_ros.pipeline.session import Session

STAMP_REASONS = ("old_stamp", "stamp_jump", "bad_stamp")
LONGEST_AHEAD_S = 10.0
"""s: a stamp that advances by this much more than the recording time is a jump."""
DETECTED, REPROJECTED, OUTLINE, SEEN = "detected", "reprojected", "outline", "seen"


@dataclass(frozen=True, slots=True)
class MessageRow:
    """One keypoint message.

    time: s since the first message, by stamps. seconds: tracking time, s. people: number of published skeletons.
    stamp_ns: ns. rejection: key of the reason, if the message was rejected.
    """

    time: float
    seconds: float
    people: int
    stamp_ns: int
    rejection: str | None = None


@dataclass(frozen=True)
class Jump:
    """A jump of the stamps. time: s, on the table's axis. ahead: s, negative for a jump back."""

    time: float
    ahead: float


@dataclass
class PersonRows:
    """The rows of one person. rejections: keys of the reasons. last: the last accepted frame."""

    records: list[Record] = field(default_factory=list)
    rejections: list[str | None] = field(default_factory=list)
    doubts: list[Doubt | None] = field(default_factory=list)
    last: FrameResult | None = None


class FrameTable:
    """Collect the frames of a playback. Its arrays are in a temporary file: 5 kB per message and person.

    messages, people: the rows, and those of each person by id, "" if one person is followed. details: explanation of
    the first rejected message, by reason. cameras: their names.
    """

    def __init__(self, session: Session) -> None:
        tracker = session.tracker
        self.cameras = tuple(session.cameras)
        self.messages: list[MessageRow] = []
        self.people: dict[str, PersonRows] = {}
        self.details: dict[str, str] = {}
        self.jumps: list[Jump] = []
        self.first_stamp_ns: int | None = None
        self._last: tuple[float, int, int] | None = None
        self._spool = ArraySpool()
        self._images: dict[str, ImageOfPerson] = {}
        self._empty = _empty_row(tracker.skeleton.joint_count, len(tracker.layout.names), len(self.cameras))

    def add(self, frames: Sequence[FrameResult], time_ns: int, seconds: float) -> None:
        """Add the frames of one keypoint message, in the order of the stamps; a listener of Playback.

        time_ns: recording time. seconds: tracking time.
        """
        stamp_ns = frames[0].stamp_ns if frames else time_ns
        refused = next((f.rejection for f in frames if not f.accepted), None)
        time = self._clock(stamp_ns, time_ns, refused not in STAMP_REASONS)
        accepted = sum(frame.accepted for frame in frames)
        self.messages.append(MessageRow(time, seconds, accepted, stamp_ns, refused))
        for frame in frames:
            if frame.rejection is not None:
                self.details.setdefault(frame.rejection, frame.detail)
            if frame.detected is not None or frame.accepted:
                rows = self.people.setdefault(frame.person, PersonRows())
                rows.records.append(self._spool.append(self._row(frame, time)))
                rows.rejections.append(frame.rejection)
                rows.doubts.append(frame.doubt if frame.accepted else None)
                rows.last = frame if frame.accepted else rows.last

    def columns(self, person: str) -> dict[str, np.ndarray]:
        """Return the rows of one person as arrays (f, ...) by name; m, rad, in the frame of the skeleton.

        Each has its time, s, on an axis by stamps that never goes back. `detected` (f, l, 2), `reprojected` and
        `outline`, the landmarks and the joints (f, n, 2) in the image, px, are those of the first camera; `in_view`
        names those of others. `seen`: whether there is an image of the camera; between its images the body is where the
        camera was last. A rejected frame has `detected` alone.
        """
        if not (records := self.of(person).records):
            return {name: np.zeros((0, *value.shape), value.dtype) for name, value in self._empty.items()}
        return self._spool.columns(records)

    def of(self, person: str) -> PersonRows:
        """Return what is not in columns: the rows of one person, without any if nobody of this id was seen."""
        return self.people.get(person, PersonRows())

    def _row(self, frame: FrameResult, time: float) -> dict[str, np.ndarray]:
        now = {image.camera.name: image for image in frame.images}
        self._images |= now  # a camera without an image at this time shows the body from where it was last
        row: dict[str, object] = {"time": time, "stamp_ns": frame.stamp_ns}
        for number, name in enumerate(self.cameras):
            if name in now:
                row[in_view(SEEN, number)] = True
                row |= {} if now[name].detected is None else {in_view(DETECTED, number): now[name].detected}
        estimate = frame.estimate
        if frame.accepted and estimate is not None and frame.positions is not None:
            pose, state, proof = estimate.pose, estimate.state, estimate.certificate
            assert pose is not None and state is not None and proof is not None
            row |= {
                "accepted": True,
                "joint_positions": pose.positions,
                "joint_rotations": state.rotations,
                "translation": state.translation,
                "joint_angles": frame.positions[3:].reshape(-1, 3),
                "landmark_positions": pose.landmarks,
                "reprojection_px": estimate.reprojection_px,
                "relative_duality_gap": proof.relative_gap,
                "kkt": proof.kkt_residual,
                "support_size": proof.support_size,
                "initialised": estimate.initialised,
                "depth": frame.camera.into_camera(pose.positions[0])[2],
                "joint_deviations": frame.uncertainty.deviation,
                "rotation_deviations": frame.uncertainty.rotation_deviation,
                "joint_observed": frame.observed,
                "joint_contacts": frame.contacts,
                "visible": estimate.visible,
            }
            for number, name in enumerate(self.cameras):
                if (image := self._images.get(name)) is not None:
                    row[in_view(REPROJECTED, number)] = image.project(pose.landmarks)
                    row[in_view(OUTLINE, number)] = image.project(pose.positions)
        return {name: np.asarray(row.get(name, value), dtype=value.dtype) for name, value in self._empty.items()}

    def _clock(self, stamp_ns: int, time_ns: int, stamp_valid: bool) -> float:
        """Return the time on the table's axis, s: by stamps, and by recording time where the stamps jump.

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


def in_view(name: str, number: int) -> str:
    """Return the name of a column of a camera, by its number."""
    return f"{name} {number}" if number else name


def _empty_row(joints: int, landmarks: int, cameras: int) -> Mapping[str, np.ndarray]:
    """Return the row of a frame without a skeleton and without keypoints."""
    shapes: dict[str, tuple[int, ...]] = {
        "joint_positions": (joints, 3),
        "joint_rotations": (joints, 3, 3),
        "translation": (3,),
        "joint_angles": (joints, 3),
        "landmark_positions": (landmarks, 3),
        "joint_deviations": (joints,),
        "rotation_deviations": (joints,),
    }
    shapes |= dict.fromkeys(("time", "reprojection_px", "relative_duality_gap", "kkt", "depth"), ())
    flags: dict[str, tuple[int, ...]] = {"accepted": (), "initialised": (), "visible": (landmarks,)}
    flags |= dict.fromkeys(("joint_observed", "joint_contacts"), (joints,))
    for number in range(cameras):
        shapes |= {in_view(name, number): (landmarks, 2) for name in (DETECTED, REPROJECTED)}
        shapes[in_view(OUTLINE, number)] = (joints, 2)
        flags[in_view(SEEN, number)] = ()
    row = {name: np.full(shape, np.nan) for name, shape in shapes.items()}
    row |= {name: np.zeros(shape, dtype=bool) for name, shape in flags.items()}
    return row | {name: np.array(0, dtype=np.int64) for name in ("stamp_ns", "support_size")}
