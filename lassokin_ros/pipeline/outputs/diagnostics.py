"""The node's status once per second: level, sentence and figures; and the warnings of a whole recording."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from lassokin_ros.core.observation import Status
from lassokin_ros.pipeline.camera_images import NOBODY
from lassokin_ros.pipeline.concerns import catalogue
from lassokin_ros.pipeline.concerns.catalogue import Raised, Seen, say, without_numbers, words_of
from lassokin_ros.pipeline.concerns.live import blocked, found
from lassokin_ros.pipeline.concerns.period import Period
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.input_checks.body_direction import BodyDirection
from lassokin_ros.pipeline.outputs import scene_messages
from lassokin_ros.pipeline.outputs.figures import figures
from lassokin_ros.pipeline.people.roster import Presence
from lassokin_ros.pipeline.session import Session
from msg_adapters.output_messages.builders import ERROR, OK, WARN, StatusLine

NEAR_LIMIT = 0.5
"""Share of `min_confidence` from which on confidences below it can be those of a person."""
NEAR_LIMIT_ADVICE = say("near_limit").text
LEVELS = {catalogue.ERROR: ERROR, catalogue.PROBLEM: WARN, catalogue.DOUBT: WARN}
"""Levels of the status by those of concerns; OK for others."""
WAITING = "no_camera_info", "no_keypoints", "silent"
"""Keys of concerns beside which the node's own concern is said."""


class Diagnostics:
    """Collects figures over one period and makes its status. Times are s of a steady clock."""

    def __init__(self, session: Session, name: str, now: float) -> None:
        """name: name of the node."""
        self._session, self._name = session, name
        self._period = Period(session, now)
        self._camera_at: float | None = None
        self._nobody = False
        self._direction = BodyDirection()
        self.concerns: list[Raised] = []
        """The warnings of the last period that a recording's summary lists."""
        self.inputs: list[str] = []
        """The texts of those that the log shows: inputs that are not what they seem."""

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
        tracking = presence.status is Status.TRACKING
        roll = None if session.config.fixed_frame else session.placement.camera_angles[0]
        self._direction.update(period.newest if tracking else (), roll, now)
        state = scene_messages.TRACKING if tracking else state
        level, message = self._level_and_text(now, state, concern)
        values = figures(period, now, self._camera_at, presence, state, as_of_ns)
        period.begin(now)
        return StatusLine(level, f"{self._name}: person", message, period.frame_id or "none", values)

    def _level_and_text(self, now: float, state: str, concern: str) -> tuple[int, str]:
        period, tracking = self._period, state == scene_messages.TRACKING
        self.concerns, self.inputs = [], []
        if reason := next(blocked(period, now, tracking), None):
            words = [reason.text, concern * (reason.key in WAITING)]
            return LEVELS.get(reason.level, OK), "; ".join(filter(None, words))
        raised = list(found(period, now, tracking, self._direction.concern(now)))
        warnings = [one for one in raised if one.level in LEVELS]
        self.concerns = [one for one in warnings if Seen.REPLAY in one.seen]
        self.inputs = words_of(raised, Seen.LOG)
        if received := period.recent["received"]:
            self._nobody = period.recent[NOBODY] == received
        if nobody := state == scene_messages.NOBODY or (self._nobody and not tracking):
            near = period.unused_confidence >= NEAR_LIMIT * self._session.tracker.config.min_confidence
            state = f"{NOBODY}; {NEAR_LIMIT_ADVICE}" if near else NOBODY
        notes = [one.text for one in raised if one not in warnings]
        words = [state, *(one.text for one in warnings), concern, *notes]
        return OK if (nobody or tracking) and not (concern or warnings) else WARN, "; ".join(filter(None, words))


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
