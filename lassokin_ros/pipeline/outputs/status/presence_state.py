"""The state of the whole image for ~/state: tracking, lost or nobody."""

from __future__ import annotations

from lassokin_ros.core.observation import Status
from lassokin_ros.pipeline.people.presence import Presence

TRACKING, LOST, NOBODY = "tracking", "lost", "nobody"


class PresenceState:
    """Derives the state from the presence of people, and detects its changes.

    tracking: somebody was tracked less than `lost_after` ago. nobody: the images of the last `stale_after` show nobody.
    lost: otherwise, that is, the last frame of a person is less than `forget_after` ago, or no usable keypoints arrive,
    so that somebody may be there.
    """

    def __init__(self) -> None:
        self.value = LOST
        """The present state."""
        self._lost_ns: int | None = None

    def update(
        self, presence: Presence, now_ns: int, lost_after: float, forget_after: float, informed: bool = True
    ) -> bool:
        """Return True if the state has changed. now_ns: ns of the clock of arrivals; lost_after, forget_after: s.

        informed: see `Session.scene_known_empty`.
        """
        before, state = self.value, self._state(presence, now_ns, forget_after - lost_after)
        self.value = LOST if state == NOBODY and not informed else state
        return self.value != before

    def _state(self, presence: Presence, now_ns: int, patience_s: float) -> str:
        if presence.status is Status.TRACKING:
            return TRACKING
        if presence.status is Status.SEARCHING or presence.ids == []:
            return NOBODY
        if presence.ids is not None:  # several people: those present are not yet forgotten
            return LOST
        if self.value == TRACKING:
            self._lost_ns = now_ns
        remembered = self._lost_ns is not None and (now_ns - self._lost_ns) * 1e-9 < patience_s
        if not remembered:
            self._lost_ns = None
        return LOST if remembered else NOBODY
