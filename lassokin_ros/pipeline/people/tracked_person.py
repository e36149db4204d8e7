"""One person: the tracker, the joint angles' continuity, and where the person is expected next."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from lassokin_ros.core.batch import Steps, run_batched, run_single
from lassokin_ros.core.body.joint_angles import JointAngleReader
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.estimate import Estimate, Observation, Status
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.lens import Lens
from lassokin_ros.pipeline.outputs.rejection_text import rejection_text

VELOCITY_MEMORY_S = 0.2
"""s: time over which a person's velocity is averaged, for the expectation alone."""

LONGEST_COURSE_S = 0.5
"""s: a person who is out of sight is expected to hold the course for this long."""


@dataclass(frozen=True, eq=False)
class Detection:
    """One person in one image.

    points: (l, 2) normalised, NaN = missing; confidence: (l,); number: the message's own; pixels: (l, 2) px
    of the image as the detector gave them, None where nothing was detected.
    """

    points: np.ndarray
    confidence: np.ndarray
    number: int = 0
    pixels: np.ndarray | None = None


class TrackedPerson:
    """Follows one person; its times are ns, of which only differences matter."""

    def __init__(self, config: TrackerConfig, skeleton: Skeleton | None = None) -> None:
        """skeleton: instead of the configuration's. Raises a LassokinError when these cannot be used."""
        self.tracker = Tracker(config, skeleton)
        self._reader = JointAngleReader(self.tracker.skeleton.axes)
        self.reset()

    def reset(self, same_camera: bool = False) -> None:
        """Forget the person; same_camera: but not how the camera is held."""
        self.tracker.reset(same_camera)
        self._reader.reset()
        self.status = Status.SEARCHING
        self.seen_ns: int | None = None
        self._origin_ns: int | None = None
        self._last: tuple[int, np.ndarray] | None = None
        #: Stamps, ns and the tracker's s, of frames that are not due yet, and what makes them.
        self._waiting: deque[tuple[int, float, Callable[..., FrameResult]]] = deque()
        self._place: np.ndarray | None = None
        self._landmarks: np.ndarray | None = None
        self._velocity = np.zeros(3)

    def track(self, stamp_ns: int, frame_id: str, seen: Detection, lens: Lens, person: str = "") -> list[FrameResult]:
        """Use one detection of this person, taken through this lens.

        What is now to be published, and last, when this detection is refused, the frame that says why. Without
        `smoothing_lag` that is this detection's frame and no other.
        """
        return run_single(self._steps(stamp_ns, frame_id, seen, lens, person))

    @staticmethod
    def track_batch(
        bodies: Mapping[str, TrackedPerson], stamp_ns: int, frame_id: str, seen: Sequence[Detection], lens: Lens
    ) -> list[list[FrameResult]]:
        """`track` for several people at once, by their ids, and what is seen of each; see `run_batched` for errors."""
        people = zip(bodies.items(), seen, strict=True)
        return run_batched([body._steps(stamp_ns, frame_id, one, lens, person) for (person, body), one in people])

    def _steps(self, stamp_ns: int, frame_id: str, seen: Detection, lens: Lens, person: str) -> Steps[list[FrameResult]]:
        """What `track` does."""
        if self._origin_ns is None:
            self._origin_ns = stamp_ns
        seconds = (stamp_ns - self._origin_ns) * 1e-9
        frame = partial(
            FrameResult,
            stamp_ns,
            frame_id,
            person=person,
            detected=seen.pixels,
            points=seen.points,
            lens=lens,
            skeleton=self.tracker.skeleton,  # this frame's: calibration's new lengths count from the next one on
        )
        observation = Observation(seconds, seen.points, seen.confidence, lens.focal)
        estimate = yield from self.tracker.steps(observation)
        self.status = estimate.status
        if estimate.rejection is not None:
            if self.seen_ns is None:
                self._origin_ns = None  # time begins with the first frame that is used
            detail = rejection_text(estimate, observation, self.tracker.config)
            return [*self._due(self.tracker.published, stamp_ns), frame(estimate, estimate.rejection.value, detail)]
        self._learn_course(stamp_ns, estimate)
        self._waiting.append((stamp_ns, estimate.stamp, partial(frame, measure=self.tracker.uncertainty)))
        return self._due(self.tracker.published, stamp_ns)

    def absent(self, stamp_ns: int, lens: Lens) -> list[FrameResult]:
        """The person is not in the image of this stamp; the frames that were waiting and are now to be published."""
        count = self.tracker.kinematics.landmark_count
        *due, _ = self.track(stamp_ns, "", Detection(np.full((count, 2), np.nan), np.zeros(count)), lens)
        return due

    def flush(self) -> list[FrameResult]:
        """The frames that wait for their `smoothing_lag`: no detection will come after them."""
        return self._due(self.tracker.flush(), self.seen_ns or 0)

    def _due(self, estimates: Sequence[Estimate], now_ns: int) -> list[FrameResult]:
        """The waiting frames that these estimates belong to, with joint states; the tracker keeps the same order."""
        frames = []
        for estimate in estimates:
            stamp_ns, stamp, frame = self._waiting.popleft()
            while stamp < estimate.stamp:  # after an error between the two
                stamp_ns, stamp, frame = self._waiting.popleft()
            positions, velocities = self._joint_states(stamp_ns, estimate)
            held_s = (now_ns - stamp_ns) * 1e-9
            frames.append(frame(estimate, positions=positions, velocities=velocities, held_s=held_s))
        return frames

    def _learn_course(self, stamp_ns: int, estimate: Estimate) -> None:
        """Where the person is and is going, by the newest frame, whether it is published yet or not."""
        assert estimate.state is not None and estimate.pose is not None
        place = estimate.state.translation
        if estimate.initialised or self._place is None or self.seen_ns is None:
            self._velocity[:] = 0.0
        else:
            seconds = (stamp_ns - self.seen_ns) * 1e-9
            share = 1 - np.exp(-seconds / VELOCITY_MEMORY_S)
            self._velocity += share * ((place - self._place) / seconds - self._velocity)
        self._place, self._landmarks, self.seen_ns = place, estimate.pose.landmarks, stamp_ns

    def _joint_states(self, stamp_ns: int, estimate: Estimate) -> tuple[np.ndarray, np.ndarray]:
        """Positions and velocities: differences of angles over stamps, 0 after initialisation."""
        assert estimate.state is not None
        if estimate.initialised:
            self._reader.reset()
            self._last = None
        angles = self._reader.read(estimate.state.rotations)
        positions = np.concatenate([estimate.state.translation, angles.ravel()])
        if self._last is None:
            velocities = np.zeros_like(positions)
        else:
            seconds = (stamp_ns - self._last[0]) * 1e-9
            velocities = (positions - self._last[1]) / seconds
        self._last = stamp_ns, positions
        return positions, velocities

    def unseen_s(self, stamp_ns: int) -> float:
        """s since the person was last tracked; infinite before the first time."""
        return float("inf") if self.seen_ns is None else (stamp_ns - self.seen_ns) * 1e-9

    def status_at(self, stamp_ns: int) -> Status:
        """What is known of the person when nothing has come until a time, which nothing is changed by."""
        lost = self.status is Status.TRACKING and self.unseen_s(stamp_ns) > self.tracker.config.lost_after
        return Status.LOST if lost else self.status

    def expected(self, stamp_ns: int) -> np.ndarray | None:
        """(l, 2) normalised: the last skeleton's landmarks, moved on sideways with the person's velocity, projected."""
        if self._landmarks is None:
            return None
        course = self._velocity * min(self.unseen_s(stamp_ns), LONGEST_COURSE_S)
        course[2] = 0.0  # depth from one camera is too unsteady to be carried on
        return project(self._landmarks + course)
