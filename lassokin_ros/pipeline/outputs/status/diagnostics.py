"""The node's status once per second: level, sentence, and figures with units."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from lassokin_ros.core.learned.height import LARGEST_FLOOR_DEVIATION
from lassokin_ros.core.observation import Rejection, Status
from lassokin_ros.doubt.live import Judgement
from lassokin_ros.pipeline.camera.camera_selection import OUTSIDE_IMAGE
from lassokin_ros.pipeline.camera_images import DEPTH_IN_MESSAGE, NOBODY, UNSCORED, UNUSED, CameraImages
from lassokin_ros.pipeline.depth_check import MISFIT
from lassokin_ros.pipeline.depth_images import COUNTS as DEPTH_COUNTS
from lassokin_ros.pipeline.depth_images import MATCHED, UNMATCHED
from lassokin_ros.pipeline.frame_result import FrameResult, repeated_s
from lassokin_ros.pipeline.image_sets import LATE
from lassokin_ros.pipeline.input_checks.body_direction import BodyDirection
from lassokin_ros.pipeline.input_checks.messages import LEADING_SLASH
from lassokin_ros.pipeline.input_checks.repeats import FROZEN_S
from lassokin_ros.pipeline.keypoint_queue import LOST, OVERTAKEN
from lassokin_ros.pipeline.outputs.status import presence_state
from lassokin_ros.pipeline.outputs.status.calibration_status import calibration_figures, height_figures
from lassokin_ros.pipeline.outputs.status.camera_status import CameraStatus, of_each_camera
from lassokin_ros.pipeline.outputs.status.doubt_words import doubt_words, unseen_words
from lassokin_ros.pipeline.outputs.status.input_concerns import input_concerns
from lassokin_ros.pipeline.people.people_tracker import FORGOTTEN, GONE
from lassokin_ros.pipeline.people.presence import Presence
from lassokin_ros.pipeline.people.tracked_person import FROZEN
from lassokin_ros.pipeline.pipeline import Pipeline
from lassokin_ros.pipeline.placeholders import PLACEHOLDERS
from lassokin_ros.pipeline.settings import MESSAGE
from msg_adapters.output_messages.builders import ERROR, OK, WARN, StatusLine

SILENCE_S = 2.0
"""s: a longer period without keypoints is a warning."""
PAST_S = 3600.0
"""s: stamps further in the past are considered those of another clock."""
LATE_S, LATEST_S = 0.5, 60.0
"""s: keypoints older than the first when they arrive are a warning; older than the second, they are probably of
a recording."""
PERIODS = 5
"""Number of the newest messages that give the period of the keypoints."""
FUTURE_S = 1.0
"""s: stamps further in the future are considered those of another clock."""
NEAR_LIMIT = 0.5
"""Share of `min_confidence` from which on confidences below it can be those of a person."""
NEAR_LIMIT_ADVICE = "confidences nearly reach min_confidence: lower it if somebody is in view"
UNUSED_SHARE = 0.02
"""Share of the messages that may be overtaken or lost without a warning."""
TURNOVER = 2
"""Number of people that may come, and leave, in one period. More are a sign of a detector that numbers people anew in
each image."""
LEAST_DEPTH_USED = 0.2
"""Share of the messages with a tracked person that use measured depth. Below it a warning is due, if most messages have
a depth image."""
NOT_SEEN = Rejection.TOO_FEW_LANDMARKS.value
NO_BODY = 0.06
"""As a fraction of the height: largest distance of keypoints from the best body that fits. Detectors have 0.02."""


class Diagnostics:
    """Collects figures over one period and makes its status. Times are s of a steady clock."""

    def __init__(self, pipeline: Pipeline, name: str, now: float) -> None:
        """name: name of the node."""
        self._pipeline = pipeline
        self._name = name
        self._since = now
        self._keypoints_at: float | None = None
        self._camera_at: float | None = None
        self._periods: deque[float] = deque(maxlen=PERIODS)
        self._counts: Counter[str] = Counter()
        self._begin(now)
        self._hardware_id = ""
        self._newest: list[FrameResult] = []  # of the last message with an accepted result
        self._last: Sequence[FrameResult] = ()  # of the last message
        self._nobody = False
        self._direction = BodyDirection()
        self._cameras = CameraStatus(pipeline)
        self.concerns: list[str] = []
        """Reasons for a warning in the last period, in words, without the messages that were not used."""
        self.inputs: list[str] = []
        """Those of them that concern inputs which are not what they seem."""

    def _begin(self, now: float) -> None:
        self._since = now
        self._counts = Counter(self._pipeline.counts)
        depths = ((name, camera.depth) for name, camera in self._pipeline.cameras.items())
        self._depth_images = Counter({name: depth.received for name, depth in depths if depth is not None})
        self._times_ms: list[float] = []
        self._delays: list[float] = []
        self._misfits: list[float] = []
        self._unused_confidence = 0.0  # largest confidence in messages without a confident keypoint
        # The person of each accepted result of the period, and what gives the doubt about it.
        self._judged: list[tuple[str, Callable[[], Judgement]]] = []
        self._tracked = self._with_depth = 0  # messages with a tracked person, and those of them with measured depth

    @property
    def camera_received(self) -> bool:
        """True if a camera_info has been received, usable or not."""
        return self._camera_at is not None

    @property
    def keypoints_received(self) -> bool:
        """True if keypoints have been received."""
        return self._keypoints_at is not None

    def count_camera_info(self, now: float) -> None:
        """Count a received camera_info."""
        self._camera_at = now

    def count_message(self, frames: Sequence[FrameResult], arrival_ns: int, now: float, callback_s: float) -> None:
        """Count a processed keypoint message.

        frames: its results, none if nobody was there. arrival_ns: ns, of the clock that stamps messages; callback_s: s,
        from the message's arrival in the callback to the last output.
        """
        if self._keypoints_at is not None:
            self._periods.append(now - self._keypoints_at)
        self._keypoints_at = now
        self._last = frames
        self._times_ms.append(1e3 * callback_s)
        if self._pipeline.nobody_in_view:
            self._unused_confidence = max(self._unused_confidence, self._pipeline.unused_confidence)
        for frame in frames[:1]:
            if arrival_ns:  # 0: a simulated clock that has not started
                self._delays.append((arrival_ns - frame.stamp_ns) * 1e-9 - frame.held_s)
            self._hardware_id = frame.frame_id or self._hardware_id
        accepted = [f for f in frames if f.accepted and f.estimate is not None]
        if accepted:
            self._newest = accepted
            self._misfits.append(max([_misfit(frame) for frame in accepted]))
            self._judged += [(frame.person, frame.judge) for frame in accepted]
            self._tracked += 1
            self._with_depth += any(f.estimate.depth_measured for f in accepted if f.estimate is not None)

    def line(
        self,
        now: float,
        presence: Presence | None = None,
        concern: str = "",
        state: str = presence_state.LOST,
        as_of_ns: int = 0,
    ) -> StatusLine:
        """Return the status of the period since the last call, and start a new one.

        presence: the present people, if more time has passed than the messages show; concern: a further reason for a
        warning, empty if there is none. state: that of ~/state, for the time when nobody is tracked. as_of_ns: ns of
        the clock of arrivals, up to which no further message has arrived; 0 for that of the last message.
        """
        presence = presence or Presence(self._pipeline.status, self._pipeline.ids)
        period = max(now - self._since, 1e-3)
        recent = Counter(self._pipeline.counts)
        recent.subtract(self._counts)
        tracking = presence.status is Status.TRACKING
        roll = None if self._pipeline.config.fixed_frame else self._pipeline.camera_angles[0]
        self._direction.update(self._newest if tracking else (), roll, now)
        figures = self._cameras.update(now, period)
        state = presence_state.TRACKING if tracking else state
        level, message = self._level_and_text(now, recent, state, concern)
        values = {**self._figures(now, period, recent, presence, state, as_of_ns), **figures}
        self._begin(now)
        return StatusLine(level, f"{self._name}: person", message, self._hardware_id or "none", values)

    def _level_and_text(self, now: float, recent: Counter[str], state: str, concern: str) -> tuple[int, str]:
        pipeline, tracking = self._pipeline, state == presence_state.TRACKING
        self.concerns, self.inputs = [], []
        if not pipeline.enabled:
            return OK, "disabled by ~/set_enabled"
        if refused_camera := of_each_camera(pipeline, _camera_fault):
            return ERROR, refused_camera
        if fault := self._cameras.fault:
            return ERROR, f"no images can be used: {fault}"
        if waiting := self._waiting_for(now):
            return WARN, "; ".join(filter(None, [waiting, concern]))
        refused = recent[f"rejected: {FROZEN}"] + recent[f"rejected: {FROZEN} (a person)"]
        if repeated_s(self._last) > FROZEN_S or (refused and not tracking):
            return WARN, (
                f"keypoints are frozen: the same ones for more than {FROZEN_S:g} s; check that "
                "the camera's image changes and reaches the detector"
            )
        self.inputs = list(input_concerns(pipeline, recent))
        unused, direction = _unused(recent), self._direction.words(now)
        possible = (
            of_each_camera(pipeline, lambda camera: "" if camera.camera.view is None else camera.camera.warning),
            unused,
            self._outside_advice(recent),
            self._fit_advice(),
            self._turnover_advice(recent),
            self._depth_concern(recent),
            self._height_concern(),
            self._clock_advice(),
            *self.inputs,
            direction if self._direction.is_down else "",
            self._stale_advice(),
            self._identity_advice() or ("" if tracking else self._lock_concern()),
            self._pipeline.people.numbers_concern,
            self._unused_lock(),
            "" if tracking or unused else self._untrackable_concern(recent),
            *self._cameras.concerns(now),
            self._doubt_concern(),
            concern,
        )
        concerns = [words for words in possible if words]
        self.concerns = [words for words in concerns if words != unused]
        if recent["received"]:
            self._nobody = recent[NOBODY] == recent["received"]
        nobody = state == presence_state.NOBODY or (self._nobody and not tracking)
        level = OK if (nobody or tracking) and not concerns else WARN
        if direction and direction not in concerns:
            concerns.append(direction)  # a person who lies is no fault
        if tracking:
            concerns += unseen_words(self._newest)  # nor is one behind a desk
        return level, "; ".join([self._nobody_text() if nobody else state, *concerns])

    def _waiting_for(self, now: float) -> str:
        """Return the input that is missing; empty if none is."""
        if not self._pipeline.has_camera:
            return "waiting for camera_info"
        if self._pipeline.config.silent_when_empty and self._pipeline.detector_connected:
            return ""
        if self._keypoints_at is None:
            return "waiting for keypoints"
        return f"no keypoints for more than {SILENCE_S:g} s" if now - self._keypoints_at > SILENCE_S else ""

    def _nobody_text(self) -> str:
        """Return that nobody is in view, with advice if the confidences of the period nearly reached the limit."""
        limit = self._pipeline.tracker.config.min_confidence
        return f"{NOBODY}; {NEAR_LIMIT_ADVICE}" if self._unused_confidence >= NEAR_LIMIT * limit else NOBODY

    def _clock_advice(self) -> str:
        """Return advice if the stamps are of another clock than the node's; else empty."""
        delay = float(np.median(self._delays)) if self._delays else 0.0
        if delay < -FUTURE_S:
            return f"stamps lie {-delay:.3g} s in the future: synchronise the clocks of the machines"
        if LATE_S < delay < LATEST_S:
            return (
                f"keypoints are {delay:.2g} s old when they arrive: the detector queues images or is too slow; let it "
                "drop old images"
            )
        if delay < PAST_S:
            return ""
        return (
            "stamps lie hours in the past: synchronise the clocks of the machines, or play a recording with "
            "`ros2 bag play --clock` and set use_sim_time"
        )

    def _stale_advice(self) -> str:
        """Return advice if people are reported as lost between two messages; else empty."""
        if len(self._periods) < PERIODS:
            return ""
        config, period = self._pipeline.config, float(np.median(self._periods))
        limits = {"stale_after": config.stale_after, "lost_after": self._pipeline.tracker.config.lost_after}
        short = {name: limit for name, limit in limits.items() if limit < period}
        if not short:
            return ""
        values = " and ".join(f"{name} is {limit:g} s" for name, limit in short.items())
        return (
            f"keypoints come every {period:.2g} s, and {values}: people are reported as lost in between; set "
            f"{'both' if len(short) > 1 else 'it'} to two or three periods"
        )

    def _identity_advice(self) -> str:
        """Return that the followed or locked person may be somebody else; else empty."""
        one, locked = self._pipeline.ids is None, self._pipeline.locked
        if any(frame.guessed and (one or frame.person == locked) for frame in self._newest):
            return "the followed person was found again by place only, and may be somebody else; ~/lock confirms it"
        return ""

    def _lock_concern(self) -> str:
        """Return that nobody is followed because somebody is locked; empty if nobody is."""
        locked = self._pipeline.locked
        if locked is None:
            return ""
        if locked == GONE:
            return FORGOTTEN
        return f"{locked} is locked and not seen: nobody else is followed until ~/lock is called with false"

    def _unused_lock(self) -> str:
        """Return that the setting `lock` has no effect; empty if it has, or is not set."""
        if not (self._pipeline.config.lock and self._pipeline.config.topic_per_body):
            return ""
        return (
            "lock is true, but nobody is locked: each person has a topic of keypoints, and the detector says who is who"
            "; set lock to false"
        )

    def _untrackable_concern(self, recent: Counter[str]) -> str:
        """Return why nobody whom the images of the period show is tracked, if several people are followed; else empty.

        Of a single person the rejections tell it.
        """
        config, settings = self._pipeline.tracker.config, self._pipeline.config
        shows_nobody = recent[NOBODY] >= recent["received"]
        if self._tracked or shows_nobody or not settings.several_people or settings.topic_per_body:
            return ""
        return (
            f"the keypoints show somebody who is not tracked: a person needs {config.min_landmarks} landmarks or more "
            f"(min_landmarks) at or above min_confidence {config.min_confidence:g}"
        )

    def _doubt_concern(self) -> str:
        """Return why poses of the period are doubtful; empty if they are not, or few and by their figures alone."""
        judged = [(person, judge()) for person, judge in self._judged]
        marked = [(person, judgement) for person, judgement in judged if judgement.doubt.likely_wrong]
        signs = [(person, judgement) for person, judgement in marked if judgement.doubt.has_sign]
        if not signs and 2 * len(marked) <= self._tracked:
            return ""
        return doubt_words(*(signs or marked)[-1])

    def _outside_advice(self, recent: Counter[str]) -> str:
        """Return advice if most keypoints of the period were outside the image; else empty."""

        def words(camera: CameraImages) -> str:
            outside, received = recent[camera.key(OUTSIDE_IMAGE)], recent[camera.key("received")]
            if (view := camera.camera.view) is None or 2 * outside <= received:
                return ""
            width, height = view.size
            return (
                f"keypoints lie outside the image of {width} x {height} px of camera_info: check that they are "
                "pixels of the raw image at full resolution, and that camera_info is of their camera"
            )

        return of_each_camera(self._pipeline, words)

    def _fit_advice(self) -> str:
        """Return advice if the keypoints of the period do not fit a body; else empty."""
        if not self._misfits or float(np.median(self._misfits)) < NO_BODY:
            return ""
        config, height = self._pipeline.tracker.config, self._pipeline.tracker.skeleton.height
        return (
            f"keypoints are more than {NO_BODY * height:.2f} m off the best body: check that the detector's landmarks "
            f"are those of `landmarks: {config.landmarks}`, in pixels of the raw image"
        )

    def _turnover_advice(self, recent: Counter[str]) -> str:
        """Return advice if more people came and left than is plausible; else empty."""
        config, changed = self._pipeline.config, min(recent["people come"], recent["people left"])
        if changed <= TURNOVER or recent["resets"] or config.topic_per_body or config.person_ids != MESSAGE:
            return ""
        return (
            "people come and leave within a second: if the message's person numbers change from image to image, "
            "set person_ids to node"
        )

    def _depth_concern(self, recent: Counter[str]) -> str:
        """Return why measured depth is not used in this period; empty if it is, or if none is configured."""
        pipeline = self._pipeline
        unused = self._with_depth < LEAST_DEPTH_USED * self._tracked
        if recent[DEPTH_IN_MESSAGE] and unused:
            return (
                "the keypoints' own depths are not near the person: check that they are in m, along the optical axis "
                "of the camera, and that the person is within its range"
            )
        if pipeline.depth is None:
            return ""
        if fault := of_each_camera(pipeline, self._depth_fault):
            return fault
        if any(camera.depth is not None and camera.depth.frozen for camera in pipeline.cameras.values()):
            return ""  # see input_concerns
        if fault := of_each_camera(pipeline, partial(_unmatched_depth, recent)):
            return fault
        if recent[MATCHED] and unused:
            return (
                "the depth images have no depth near the person at the keypoints: check that they are in mm (16UC1) "
                "or m (32FC1) and registered to the colour image, and that the person is within the camera's range"
            )
        return ""

    def _depth_fault(self, camera: CameraImages) -> str:
        """Return why the depth images of a camera are not used; empty if they are."""
        if camera.depth is None:
            return ""
        if camera.depth.received == self._depth_images[camera.name]:
            topic = self._pipeline.config.depth_topic(camera.name)
            return f"no depth images on {topic}: tracking without measured depth"
        return camera.depth.fault or camera.depth_check.fault

    def _height_concern(self) -> str:
        """Return why the person's height is probably wrong, as measured depth shows; empty if it is not."""
        pipeline, config = self._pipeline, self._pipeline.tracker.config
        if config.height == 0:
            heights = pipeline.heights().values()
            if not self._tracked or any(height.measured for height in heights):
                return ""
            assumed = f"{config.assumed_height:g} m is assumed"
            floor = max((height.floor_deviation for height in heights), default=0.0)
            if floor < LARGEST_FLOOR_DEVIATION:
                return f"height is 0, but no depth is measured: {assumed}"
            return (
                f"height is 0, but with a tilt known to {config.tilt_deviation:g} rad the floor gives it to "
                f"{100 * floor:.0f} % from here, more than {100 * LARGEST_FLOOR_DEVIATION:.0f} %: {assumed}; come "
                "nearer, raise the camera, or set height"
            )
        checks = [tracker.learned.size_check for tracker in pipeline.trackers.values()]
        wrong = [check for check in checks if check.wrong]
        if wrong:
            return (
                f"measured depth does not fit the size of the given body (height {config.height:g} m): set height to "
                "that of the person, or to 0 to measure it, and check that camera_info is of the keypoints' camera"
            )
        return ""

    def _largest_deviation(self) -> float:
        return max((float(f.uncertainty.deviation.max()) for f in self._newest), default=float("nan"))

    def _reprojection_px(self) -> float:
        return max((f.estimate.reprojection_px for f in self._newest if f.estimate is not None), default=float("nan"))

    def _figures(
        self, now: float, period: float, recent: Counter[str], presence: Presence, state: str, as_of_ns: int
    ) -> dict[str, str]:
        counts = self._pipeline.counts
        followed = presence.status is Status.TRACKING  # the last figures of a lost person are outdated
        values = {
            "state": state,
            "input rate [Hz]": f"{recent['received'] / period:.2f}",
            "output rate [Hz]": f"{recent['accepted'] / period:.2f}",
            "keypoints age [s]": _age(now, self._keypoints_at),
            "camera_info age [s]": _age(now, self._camera_at),
            "keypoints delay median [s]": _figure(self._delays, 50),
            "callback time median [ms]": _figure(self._times_ms, 50),
            "callback time maximum [ms]": _figure(self._times_ms, 100),
            "reprojection error [px]": f"{self._reprojection_px() if followed else math.nan:.2f}",
            "largest joint deviation [m]": f"{self._largest_deviation() if followed else math.nan:.3f}",
        }
        for key in ("received", "accepted", "duplicated", "unstamped", "ignored while disabled", OVERTAKEN, LOST):
            values[f"{key} [messages]"] = str(counts[key])
        values["resets"] = str(counts["resets"])
        values["locked"] = self._pipeline.locked or "nobody"
        newest = (0, "") if self._pipeline.config.topic_per_body else self._pipeline.image  # each body has its own
        if newest is not None:
            stamp_ns = self._pipeline.image_at(as_of_ns)[0] if as_of_ns else newest[0]
            values["people in view, not tracked"] = str(self._pipeline.untracked_at(stamp_ns))
        if presence.ids is not None:
            values["people"] = ", ".join(presence.ids) or "nobody"
            gone = len(set(self._pipeline.ids or ()) - set(presence.ids))  # in a silence: the next message counts them
            values["people come"], values["people left"] = str(counts["people come"]), str(counts["people left"] + gone)
            values["people beyond max_people"] = str(counts["people beyond max_people"])
        if self._pipeline.mount is not None and (angles := self._pipeline.mount.angles) is not None:
            values["camera roll, pitch from TF [rad]"] = "{:.3f}, {:.3f}".format(*angles)
        if (above := self._pipeline.camera_height) is not None:
            values["camera height above the floor [m]"] = f"{above:.3f}"
        if self._pipeline.depth is not None:
            values |= {f"{key} [messages]": str(counts[key]) for key in DEPTH_COUNTS}
        listed = (LATE, MISFIT, OUTSIDE_IMAGE, PLACEHOLDERS, NOBODY, UNUSED, UNSCORED, DEPTH_IN_MESSAGE, LEADING_SLASH)
        for key in sorted(key for key in counts if key.startswith("rejected: ") or key in listed):
            values[f"{key} [messages]"] = str(counts[key])
        if self._unused_confidence:
            values["largest unused confidence"] = f"{self._unused_confidence:.2f}"
        tracker = self._pipeline.tracker
        if tracker.averaged:
            values["skeleton: left/right difference, averaged [%]"] = f"{100 * tracker.averaged:.1f}"
        for person, calibration in self._pipeline.calibrations().items():
            if presence.ids is None or person in presence.ids:
                values |= calibration_figures(calibration, tracker.config.calibrate, person)
        if tracker.limitations:
            values["limitations"] = tracker.limitations
        values |= {f"evidence '{name}'": fault for name, fault in self._pipeline.evidence_faults.items()}
        for person, one in self._pipeline.trackers.items():
            ratio = one.learned.size_check.ratio
            if ratio != 1.0 and (presence.ids is None or person in presence.ids):
                values[f"{person} measured size / given size".strip()] = f"{ratio:.2f}"
        for person, height in self._pipeline.heights().items():
            if presence.ids is None or person in presence.ids:
                values |= height_figures(height, person)
        return values


def _misfit(frame: FrameResult) -> float:
    """As a fraction of the height: distance of the keypoints of an accepted frame from its body's landmarks, at its
    distance.
    """
    estimate = frame.estimate
    assert estimate is not None and estimate.state is not None and frame.lens is not None and frame.skeleton is not None
    depth = float(frame.camera.into_camera(estimate.state.translation)[2])
    return estimate.reprojection_px / frame.lens.focal * depth / frame.skeleton.height


def _camera_fault(camera: CameraImages) -> str:
    """Return why the last camera_info of a camera was refused; empty if it was not."""
    if not camera.camera.fault:
        return ""
    kept = "" if camera.camera.view is None else "; the last good one is used"
    return f"camera_info refused: {camera.camera.fault}{kept}"


def _unmatched_depth(recent: Counter[str], camera: CameraImages) -> str:
    """Return that most messages of a camera had no depth image; empty if that is not the case."""
    if recent[camera.key(UNMATCHED)] <= recent[camera.key(MATCHED)]:
        return ""
    return (
        "most keypoint messages had no depth image of their time: check that both have the stamp of the camera, and "
        "that depth images arrive before the keypoints"
    )


def _unused(recent: Counter[str]) -> str:
    """Return why messages of a period were not used; empty if all were. The figures contain the numbers."""
    refused = {key.partition(": ")[2]: n for key, n in recent.items() if key.startswith("rejected: ")}
    if NOT_SEEN in refused:
        refused[NOT_SEEN] -= recent[NOBODY]
    reasons = sorted(reason for reason, count in refused.items() if count > 0)
    parts = [f"messages {key}" for key in (OVERTAKEN, LOST) if recent[key] > UNUSED_SHARE * recent["received"]]
    return "; ".join([*([f"keypoints rejected: {', '.join(reasons)}"] if reasons else []), *parts])


def _age(now: float, then: float | None) -> str:
    return "never" if then is None else f"{now - then:.3f}"


def _figure(values: list[float], percentile: int) -> str:
    return f"{np.percentile(values, percentile):.3f}" if values else "nan"
