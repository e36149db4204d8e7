"""The node's status once per second: level, sentence and figures; and the warnings of a whole recording."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import partial

from lassokin_ros.core.observation import Status
from lassokin_ros.pipeline.camera_images import NOBODY
from lassokin_ros.pipeline.concerns import catalogue, live
from lassokin_ros.pipeline.concerns.cameras import SILENCE_S, camera_concerns, no_usable_image
from lassokin_ros.pipeline.concerns.catalogue import Raised, Seen, say, without_numbers, words_of
from lassokin_ros.pipeline.concerns.period import Period
from lassokin_ros.pipeline.frame_result import FrameResult, repeated_s
from lassokin_ros.pipeline.input_checks.body_direction import BodyDirection
from lassokin_ros.pipeline.input_checks.messages import FROZEN_S
from lassokin_ros.pipeline.outputs import scene_messages
from lassokin_ros.pipeline.outputs.figures import CameraStatus, figures
from lassokin_ros.pipeline.people.roster import Presence
from lassokin_ros.pipeline.people.tracked_person import FROZEN
from lassokin_ros.pipeline.session import Session
from msg_adapters.output_messages.builders import ERROR, OK, WARN, StatusLine

NEAR_LIMIT = 0.5
"""Share of `min_confidence` from which on confidences below it can be those of a person."""
NEAR_LIMIT_ADVICE = say("near_limit").text
WARNINGS = catalogue.PROBLEM, catalogue.DOUBT
"""Levels of concerns that are a warning of the status."""


class Diagnostics:
    """Collects figures over one period and makes its status. Times are s of a steady clock."""

    def __init__(self, session: Session, name: str, now: float) -> None:
        """name: name of the node."""
        self._session, self._name = session, name
        self._period = Period(session, now)
        self._camera_at: float | None = None
        self._nobody = False
        self._direction = BodyDirection()
        self._cameras = CameraStatus(session)
        self.concerns: list[Raised] = []
        """The warnings of the last period that a recording's summary lists."""
        self.inputs: list[str] = []
        """The texts of those that the log shows: inputs that are not what they seem."""

    @property
    def camera_received(self) -> bool:
        """True if a camera_info has been received, usable or not."""
        return self._camera_at is not None

    @property
    def keypoints_received(self) -> bool:
        """True if keypoints have been received."""
        return self._period.keypoints_at is not None

    def count_camera_info(self, now: float) -> None:
        """Count a received camera_info."""
        self._camera_at = now

    def count_message(self, frames: Sequence[FrameResult], arrival_ns: int, now: float, callback_s: float) -> None:
        """Count a processed keypoint message.

        frames: its results, none if nobody was there. arrival_ns: ns, of the clock that stamps messages; callback_s: s,
        from the message's arrival in the callback to the last output.
        """
        self._period.add(frames, arrival_ns, now, callback_s)

    def line(
        self,
        now: float,
        presence: Presence | None = None,
        concern: str = "",
        state: str = scene_messages.LOST,
        as_of_ns: int = 0,
    ) -> StatusLine:
        """Return the status of the period since the last call, and start a new one.

        presence: the present people, if more time has passed than the messages show; concern: a further reason for a
        warning, empty if there is none. state: that of ~/state, for the time when nobody is tracked. as_of_ns: ns of
        the clock of arrivals, up to which no further message has arrived; 0 for that of the last message.
        """
        session, period = self._session, self._period
        presence = presence or Presence(session.roster.status, session.roster.ids)
        seconds = max(now - period.since, 1e-3)
        tracking = presence.status is Status.TRACKING
        roll = None if session.config.fixed_frame else session.placement.camera_angles[0]
        self._direction.update(period.newest if tracking else (), roll, now)
        of_cameras = self._cameras.update(now, seconds)
        state = scene_messages.TRACKING if tracking else state
        level, message = self._level_and_text(now, state, concern)
        ages = now, self._camera_at
        values = {**figures(period, seconds, ages, presence, state, as_of_ns), **of_cameras}
        self._period = Period(session, now, period)
        return StatusLine(level, f"{self._name}: person", message, period.frame_id or "none", values)

    def _level_and_text(self, now: float, state: str, concern: str) -> tuple[int, str]:
        self.concerns, self.inputs = [], []
        if blocked := next(self._blocked(now, state), None):
            level = {catalogue.ERROR: ERROR, catalogue.NOTE: OK}.get(blocked.level, WARN)
            return level, "; ".join(filter(None, [blocked.text, concern * (blocked.key in live.WAITING)]))
        tracking, recent = state == scene_messages.TRACKING, self._period.recent
        found = list(self._found(now, tracking))
        self.concerns = [raised for raised in found if Seen.SUMMARY in raised.seen and raised.level in WARNINGS]
        self.inputs = words_of(found, Seen.LOG)
        if recent["received"]:
            self._nobody = recent[NOBODY] == recent["received"]
        nobody = state == scene_messages.NOBODY or (self._nobody and not tracking)
        warned = concern or any(raised.level in WARNINGS for raised in found)
        warnings = [raised.text for raised in found if raised.level in WARNINGS]
        notes = [raised.text for raised in found if raised.level not in WARNINGS]
        words = [self._nobody_text() if nobody else state, *warnings, concern, *notes]
        return OK if (nobody or tracking) and not warned else WARN, "; ".join(filter(None, words))

    def _blocked(self, now: float, state: str) -> Iterator[Raised]:
        """Yield why nothing can be tracked, the most important reason first."""
        session, period = self._session, self._period
        if not session.enabled:
            yield say("disabled")
        if refused := list(live.camera_refused(session)):
            yield refused[0]._replace(text="; ".join(raised.text for raised in refused))
        yield from no_usable_image(session, self._cameras.sending)
        if not session.inputs.has_camera:
            yield say("no_camera_info")
        elif not (session.config.silent_when_empty and session.scene.detector_connected):
            if period.keypoints_at is None:
                yield say("no_keypoints")
            elif now - period.keypoints_at > SILENCE_S:
                yield say("silent", limit=SILENCE_S)
        refused_s = period.recent[f"rejected: {FROZEN}"] + period.recent[f"rejected: {FROZEN} (a person)"]
        if repeated_s(period.last) > FROZEN_S or (refused_s and state != scene_messages.TRACKING):
            yield say("frozen", limit=FROZEN_S)

    def _found(self, now: float, tracking: bool) -> Iterator[Raised]:
        """Yield the concerns of the period, in the order in which they are said."""
        period = self._period
        unused = list(live.rejections(period))
        rules = live.OF_INPUTS, live.WHILE_TRACKING if tracking else live.WHILE_NOT_TRACKING
        yield from unused
        yield from (raised for of_state in rules for rule in of_state for raised in rule(period))
        if direction := self._direction.concern(now):
            yield direction
        if not tracking and not unused:
            yield from live.untrackable(period)
        cameras = self._cameras
        yield from camera_concerns(self._session, cameras.sending, partial(cameras.silent_s, now))
        yield from live.likely_wrong(period)
        if tracking:
            yield from live.unseen(period)

    def _nobody_text(self) -> str:
        """Return that nobody is in view, with advice if the confidences of the period nearly reached the limit."""
        limit = NEAR_LIMIT * self._session.tracker.config.min_confidence
        return f"{NOBODY}; {NEAR_LIMIT_ADVICE}" if self._period.unused_confidence >= limit else NOBODY


class WarningLog:
    """Collects the warnings of each period of the diagnostics."""

    def __init__(self) -> None:
        self._found: dict[str, tuple[int, Raised]] = {}

    def add(self, warnings: Iterable[Raised]) -> None:
        """Add the warnings of one period. Those that differ in their numbers only are one; the first text is kept."""
        for raised in warnings:
            key = without_numbers(raised.text)
            count, first = self._found.get(key, (0, raised))
            self._found[key] = count + 1, first

    @property
    def found(self) -> list[Raised]:
        """The warnings, the most frequent first, each with its number of periods of 1 s."""
        ordered = sorted(self._found.values(), key=lambda item: -item[0])
        return [raised._replace(text=f"{raised.text} (for {count} s)") for count, raised in ordered]
