"""What was received and tracked in one period of the diagnostics, which is 1 s."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Sequence
from functools import cached_property

from lassokin_ros.doubt.monitor import Pending
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.session import Session

INTERVALS = 5
"""Number of the newest messages that give the interval between keypoints."""


class Period:
    """Figures of one period. Times are s of a steady clock.

    Lists have one entry per message: times_ms, ms, of the callbacks; delays, s, from stamp to arrival, without the wait
    of `smoothing_lag`; misfits, see `misfit`, the largest one. judged: the person of each accepted result, and what
    gives the doubt about it. unused_confidence: the largest one in messages without a confident keypoint. tracked,
    with_depth: messages with a tracked person, and those of them with measured depth. newest: accepted results of the
    last message that has some; last: all results of the last message.
    """

    def __init__(self, session: Session, now: float, before: Period | None = None) -> None:
        """before: the last period, whose newest messages are still the newest ones."""
        self.session, self.since = session, now
        self._counts = Counter(session.counts)
        depths = ((name, camera.depth) for name, camera in session.cameras.items())
        self._depth_images = Counter({name: depth.received for name, depth in depths if depth is not None})
        self.times_ms: list[float] = []
        self.delays: list[float] = []
        self.misfits: list[float] = []
        self.judged: list[tuple[str, Pending]] = []
        self.unused_confidence = 0.0
        self.tracked = self.with_depth = 0
        self.newest: Sequence[FrameResult] = () if before is None else before.newest
        self.last: Sequence[FrameResult] = () if before is None else before.last
        self.keypoints_at: float | None = None if before is None else before.keypoints_at
        self.frame_id: str = "" if before is None else before.frame_id
        self.intervals: deque[float] = deque(maxlen=INTERVALS) if before is None else before.intervals

    @cached_property
    def recent(self) -> Counter[str]:
        """The counts of this period, at the first access."""
        recent = Counter(self.session.counts)
        recent.subtract(self._counts)
        return recent

    def depth_images(self, camera: str) -> int:
        """Return the number of depth images that a camera with depth has sent."""
        depth = self.session.cameras[camera].depth
        return 0 if depth is None else int(depth.received - self._depth_images[camera])

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
            self.tracked += 1
            self.with_depth += any(f.estimate.frame.depth_measured for f in accepted if f.estimate and f.estimate.frame)


def misfit(frame: FrameResult) -> float:
    """As a fraction of the height: distance of the keypoints of an accepted frame from its body's landmarks, at its
    distance.
    """
    estimate = frame.estimate
    assert estimate is not None and estimate.state is not None and frame.lens is not None and frame.skeleton is not None
    depth = float(frame.camera.into_camera(estimate.state.translation)[2])
    return estimate.reprojection_px / frame.lens.focal * depth / frame.skeleton.height
