"""Order of time stamps: detect old messages and jumps of time (bag loop, seek, change of clock).

A stamp that advances no more than the arrival clock is a pause, however long. A jump back to a time already processed
is a bag loop or a seek and is accepted at once. Any other jump needs confirmation by the next message, so that one
wrong stamp (in the future, or in 1970) has no effect. A wrong stamp can be so little ahead that it is accepted. The
next ones then continue the stamp before it, which a loop or a seek does not: they are old until they have passed it.

Stamps in another unit advance faster or slower than the arrivals. Examples: a time in us or ms in place of ns, or a
field nanosec in us (then only one step per second is right).
"""

from __future__ import annotations

from collections import deque

import numpy as np

from lassokin_ros.pipeline.concerns.catalogue import Raised, say
from msg_adapters.errors import AdapterError

ALWAYS_AHEAD_S = 2.0
"""s: a stamp may be ahead of the previous stamp by this, plus FASTEST times the time between their arrivals."""
FASTEST = 10.0
"""Largest playback rate of a recording. A pause in the recording is shorter by this factor during playback."""

JUMP_BACK_S = 0.5
"""s: a stamp that is older than the newest one by more than this is a jump back: a bag loops, or is rewound."""
LITTLE_AHEAD_S = 4.0
"""s: a stamp that was wrong and farther ahead is left behind by a jump back, not waited for."""

DEFAULT_PERIOD_NS = 33_333_333
"""ns: assumed period of the messages before two stamps are known."""
DELAY_SHARE = 0.1
"""Weight of a new message in the average of the delays."""


class StampWatch:
    """Tracks the newest processed stamp, and a jump that is not confirmed yet; ns."""

    def __init__(self) -> None:
        self.rate = StampRate()
        """The rates of the stamps and of the arrivals."""
        self.reset()

    def reset(self) -> None:
        """Forget all stamps, but not their rate. The next stamp is accepted, whatever it is."""
        self._oldest: int | None = None
        self._newest: int | None = None
        self._jump: int | None = None
        self._used: int | None = None  # the last stamp that was not refused, and the one before it
        self._before: int | None = None
        self._reference: tuple[int, int] | None = None
        self._period_ns: int | None = None
        self._last = 0, 0
        self.delay_s: float | None = None
        """s from stamp to arrival, averaged; None before the first stamp."""

    def estimate(self, arrival_ns: int) -> int:
        """Return the stamp of a message that has none, ns.

        It is the arrival time if no message had a stamp yet. Otherwise it continues the stamps of the other messages
        by the time since the last arrival, at most by one period: the next stamp must not lie before it.
        """
        if self._reference is None:
            return arrival_ns
        stamp_ns, last_arrival = self._reference
        longest = DEFAULT_PERIOD_NS if self._period_ns is None else self._period_ns
        return stamp_ns + min(max(arrival_ns - last_arrival, longest // 10), longest)

    def follow(self, stamp_ns: int, arrival_ns: int, stamped: bool) -> None:
        """Record the stamp of an accepted message as reference for `estimate`; stamped: the message had it itself."""
        if self._reference is None and not stamped:
            return
        if self._reference is not None and stamped and (step := stamp_ns - self._reference[0]) > 0:
            self._period_ns = step if self._period_ns is None else min(step, 2 * self._period_ns)
        self._reference = stamp_ns, arrival_ns

    def check(self, stamp_ns: int, arrival_ns: int, stamped: bool = False) -> bool:
        """Return True if time jumped back by more than JUMP_BACK_S, so that the state must be reset.

        arrival_ns: ns of any monotonic clock. stamped: whether the message had the stamp itself: the first one after
        others without is of another clock, and a jump. Raises AdapterError for an old stamp (`old_stamp`) and for a
        jump that does not follow another jump (`stamp_jump`).
        """
        if stamped:
            self.rate.add(stamp_ns, arrival_ns)
        try:
            back = self._newest is not None and self._compare(stamp_ns, arrival_ns, self._newest)
        except AdapterError:
            if not stamped or self._reference is not None:
                raise
            return True
        if stamped:
            delay_s = (arrival_ns - stamp_ns) * 1e-9
            before_s = delay_s if back or self.delay_s is None else self.delay_s
            self.delay_s = before_s + DELAY_SHARE * (delay_s - before_s)
        self._last = stamp_ns, arrival_ns
        if not back:  # an image of the new time may not be usable, and then changes nothing
            self._before, self._used = self._used, stamp_ns
        return back

    def _compare(self, stamp_ns: int, arrival_ns: int, newest: int) -> bool:
        ahead = (stamp_ns - newest) * 1e-9
        if stamp_ns == newest:
            raise AdapterError("old_stamp", "the stamp has not changed; the detector must copy the stamp of each image")
        if -JUMP_BACK_S <= ahead < 0:
            raise AdapterError("old_stamp", f"the stamp is {abs(ahead):.3f} s older than the newest one")
        if self._before is not None and self._before < stamp_ns < newest and -ahead < LITTLE_AHEAD_S:
            self._before = stamp_ns
            raise AdapterError(
                "old_stamp", f"the stamp is {abs(ahead):.3f} s older than the newest one, which was ahead of its time"
            )
        step, waited = (now - last for now, last in zip((stamp_ns, arrival_ns), self._last))
        if ahead > 0 and step * 1e-9 <= ALWAYS_AHEAD_S + FASTEST * max(waited, 0) * 1e-9:
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

    def seen(self, stamp_ns: int, tracked: bool) -> None:
        """Record the stamp of a processed message; tracked: True if the message updated a track."""
        self._oldest = stamp_ns if self._oldest is None else min(self._oldest, stamp_ns)
        if tracked:
            self._newest = stamp_ns


KEPT, KEPT_NS = 2000, 5_000_000_000
"""Messages that are compared, and ns of arrivals."""
FEWEST_MESSAGES, SHORTEST_S = 20, 2.0
"""Messages, and s of arrivals without pauses, before anything is compared."""
FARTHEST = 2.1
"""Largest ratio of the rates without a warning."""
LONG_STEP, REGULAR = 10.0, 0.9
"""A step between arrivals is a pause if it is longer than LONG_STEP medians. Arrivals are regular if this share of
their steps is no pause; those of a detector that works in batches are not."""

JUMP_NS = 2_000_000_000
"""ns: stamps that advance by more, without such a time between the arrivals, jump to another time."""


class StampRate:
    """Keeps the stamps and arrivals of the last messages."""

    def __init__(self) -> None:
        self._pairs: deque[tuple[int, int]] = deque(maxlen=KEPT)

    def add(self, stamp_ns: int, arrival_ns: int) -> None:
        """Add a message. A jump of a clock starts the comparison anew; arrival_ns: ns of the clock of arrivals."""
        if self._pairs:
            step, waited = stamp_ns - self._pairs[-1][0], arrival_ns - self._pairs[-1][1]
            if min(step, waited) < 0 or step > JUMP_NS + LONG_STEP * waited:
                self._pairs.clear()
        self._pairs.append((stamp_ns, arrival_ns))
        while arrival_ns - self._pairs[0][1] > KEPT_NS:
            self._pairs.popleft()

    @property
    def concern(self) -> Raised | None:
        """That both rates differ by more than FARTHEST."""
        if len(self._pairs) < FEWEST_MESSAGES:
            return None
        stamps, arrivals = 1e-9 * np.diff(np.array(self._pairs), axis=0).T
        usual = arrivals <= LONG_STEP * np.median(arrivals)
        regular = bool(np.mean(usual) >= REGULAR)
        if regular:
            stamps, arrivals = stamps[usual], arrivals[usual]
        if arrivals.sum() < SHORTEST_S:
            return None
        for mean in (np.mean, np.median) if regular else (np.mean,):
            step, period = float(mean(stamps)), float(mean(arrivals))
            if period > 0 and not 1 / FARTHEST <= step / period <= FARTHEST:
                rate = f"{1 / step:.3g} Hz" if step > 0 else "no time between them"
                return say("stamp_rate", rate=rate, arrivals=1 / period)
        return None
