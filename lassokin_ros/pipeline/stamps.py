"""The order of time: which message is old, and when time itself has jumped (bag loop, seek, another clock).

A stamp that is ahead by what has passed on the clock of arrival is a pause, however long. A jump back to a time that
has been seen is a bag that loops or a seek, and believed at once. Of any other time one message is somebody's mistake
and two in a row are a new time: such a jump is believed when the next message confirms it, so that a single stamp from
the future, or from 1970, changes nothing.
"""

from __future__ import annotations

from msg_adapters.errors import AdapterError

ALWAYS_AHEAD_S = 2.0
"""s: a stamp may be ahead of the last message's by this, and by FASTEST times what passed between their arrivals."""
FASTEST = 10.0
"""A recording may be played this many times faster than it was made; a pause in it then is as much shorter."""


class StampWatch:
    """Remembers the newest stamp that was used, and the jump that waits for its confirmation; ns."""

    _oldest: int | None
    _newest: int | None
    _jump: int | None
    _last: tuple[int, int]

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the time: every stamp is welcome."""
        self._oldest = self._newest = self._jump = None

    def check(self, stamp_ns: int, arrival_ns: int, jump_back: float) -> bool:
        """True when time has jumped back by more than jump_back (s): what was before must be forgotten.

        arrival_ns: ns of any one clock that goes on. Raises AdapterError for a stamp that is old, and for one that
        jumps and does not follow another one that jumped.
        """
        back = self._newest is not None and self._compare(stamp_ns, arrival_ns, self._newest, jump_back)
        self._last = stamp_ns, arrival_ns
        return back

    def _compare(self, stamp_ns: int, arrival_ns: int, newest: int, jump_back: float) -> bool:
        ahead = (stamp_ns - newest) * 1e-9
        if -jump_back <= ahead <= 0:
            raise AdapterError("old_stamp", f"the stamp is {abs(ahead):.3f} s older than the newest one")
        if ahead > 0 and self._goes_on(stamp_ns, arrival_ns):
            self._jump = None
            return False
        if self._oldest is not None and self._oldest <= stamp_ns < newest:
            return True
        before, self._jump = self._jump, stamp_ns
        if before is None or stamp_ns <= before or (before > newest) != (ahead > 0):
            way = "ahead of" if ahead > 0 else "behind"
            raise AdapterError(
                "stamp_jump", f"the stamp is {abs(ahead):.3f} s {way} the newest one; the next message must confirm it"
            )
        return ahead < 0

    def _goes_on(self, stamp_ns: int, arrival_ns: int) -> bool:
        """True when the stamp is no farther ahead of the last one than time has passed, or little."""
        last_stamp, last_arrival = self._last
        return (stamp_ns - last_stamp) * 1e-9 <= ALWAYS_AHEAD_S + FASTEST * max(arrival_ns - last_arrival, 0) * 1e-9

    def seen(self, stamp_ns: int, tracked: bool) -> None:
        """A message of this stamp has been taken; tracked: somebody was tracked in it, so that time goes on."""
        self._oldest = stamp_ns if self._oldest is None else min(self._oldest, stamp_ns)
        if tracked:
            self._newest = stamp_ns
