"""What was received and tracked in one period of the diagnostics, which is 1 s."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Sequence

from lassokin_ros.doubt.monitor import Pending
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.session import Session

INTERVALS = 5
"""Number of the newest messages that give the interval between keypoints."""


class Period:
    """Figures of the present period. Times are s of a steady clock.

    times_ms: of the callbacks; delays: s from stamp to arrival, without the wait of `smoothing_lag`; misfits: one per
    message with a tracked person, see `misfit`, the largest one; with_depth: number of those with measured depth.
    judged: the person of each accepted result, and what gives the doubt about it. unused_confidence: the largest one in
    messages without a confident keypoint.

    Of earlier periods, too: newest, the accepted results of the last message that has some; last, all results of the
    last message; keypoints_at, when it came; frame_id of its results; intervals between the newest messages.
    """

    def __init__(self, session: Session, now: float) -> None:
        self.session = session
        self.newest: Sequence[FrameResult] = ()
        self.last: Sequence[FrameResult] = ()
        self.keypoints_at: float | None = None
        self.frame_id = ""
        self.intervals: deque[float] = deque(maxlen=INTERVALS)
        self._heard = dict.fromkeys(session.cameras, now)  # end of the last period with messages, by camera
        self._counts = Counter(session.counts)
        self.begin(now)

    def begin(self, now: float) -> None:
        """Begin the next period."""
        self._heard |= dict.fromkeys(self.sending, now)
        self.since, self._counts = now, Counter(self.session.counts)
        self.times_ms: list[float] = []
        self.delays: list[float] = []
        self.misfits: list[float] = []
        self.judged: list[tuple[str, Pending]] = []
        self.with_depth, self.unused_confidence = 0, 0.0

    @property
    def recent(self) -> Counter[str]:
        """The counts of this period."""
        recent = Counter(self.session.counts)
        recent.subtract(self._counts)
        return recent

    @property
    def tracked(self) -> int:
        """Number of messages with a tracked person."""
        return len(self.misfits)

    @property
    def sending(self) -> list[str]:
        """The cameras with messages."""
        recent = self.recent
        return [name for name, camera in self.session.cameras.items() if recent[camera.key("received")]]

    def silent_s(self, camera: str, now: float) -> float:
        """Return s since the last period with messages of a camera, or since the begin."""
        return 0.0 if camera in self.sending else now - self._heard[camera]

    def add(self, frames: Sequence[FrameResult], arrival_ns: int, now: float, callback_s: float) -> None:
        """Add a message, see `Diagnostics.count_message`."""
        if self.keypoints_at is not None:
            self.intervals.append(now - self.keypoints_at)
        self.keypoints_at, self.last = now, frames
        self.times_ms.append(1e3 * callback_s)
        if self.session.inputs.nobody_in_view:
            self.unused_confidence = max(self.unused_confidence, self.session.inputs.unused_confidence)
        for frame in frames[:1]:
            if arrival_ns:  # 0: a simulated clock that has not started
                self.delays.append((arrival_ns - frame.stamp_ns) * 1e-9 - frame.held_s)
            self.frame_id = frame.frame_id or self.frame_id
        accepted = [frame for frame in frames if frame.accepted and frame.estimate is not None]
        if accepted:
            self.newest = accepted
            self.misfits.append(max(map(misfit, accepted)))
            self.judged += [(frame.person, frame.pending) for frame in accepted if frame.pending is not None]
            self.with_depth += any(f.estimate.frame.depth_measured for f in accepted if f.estimate and f.estimate.frame)


def misfit(frame: FrameResult) -> float:
    """Return the distance of an accepted frame's keypoints from its body, at its distance, over the body's height."""
    estimate = frame.estimate
    assert estimate is not None and estimate.state is not None and frame.lens is not None and frame.skeleton is not None
    depth = float(frame.camera.into_camera(estimate.state.translation)[2])
    return estimate.reprojection_px / frame.lens.focal * depth / frame.skeleton.height
