"""Whether a detector's person numbers are used: a number is evidence beside the place, never instead of it.

A number that is the index of a person in the image, or one that a detector gives to somebody else, would lead a lock
to another person. Numbers are therefore used where the person is expected, and only as far as they have proved to last.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

SILENCE_S = 0.5
"""s: after a longer silence of the detector, and one of SILENT_PERIODS, it may have restarted: its numbers are new."""
SILENT_PERIODS = 3.0
PAUSE_PERIODS, PAUSE_GROWTH = 1.75, 1.2
"""Usual periods, from which on images have paused; and growth of the usual period by a pause."""
JUMP_MEMORY_S = 60.0
"""s: numbers are not used for this long after one has jumped from one person to another."""


class Numbers:
    """The person numbers of one detector. Times are stamps, ns."""

    def __init__(self, sure: bool = False) -> None:
        """sure: the user says that a number is one person's, wherever it is (`person_ids: lasting`)."""
        self.sure = self.proven = sure
        """proven: whether an image had numbers that are no index in it, from 0 or 1 on."""
        self._heard_ns: int | None = None
        self.gap_s = self.period_s = 0.0
        """s between the two newest images; and usually: a pause hardly counts."""
        self._jump: tuple[int, int] | None = None  # stamp, ns, and number

    def hear(self, stamp_ns: int, numbers: Sequence[int]) -> bool:
        """Note the numbers of an image. Return True after a silence: nobody has a number from before."""
        self.gap_s = 0.0 if self._heard_ns is None else (stamp_ns - self._heard_ns) * 1e-9
        silent = self.gap_s > max(SILENCE_S, SILENT_PERIODS * self.period_s)
        self._heard_ns, usual_s = stamp_ns, self.period_s
        if not silent and self.gap_s > 0:
            self.period_s = min(self.gap_s, PAUSE_GROWTH * usual_s) if self.is_pause(self.gap_s) else self.gap_s
        if numbers and not (min(numbers) in (0, 1) and max(numbers) - min(numbers) == len(numbers) - 1):
            self.proven = True
        return silent and not self.sure

    def is_pause(self, seconds: float) -> bool:
        """Return whether a time between two images, s, is longer than usual."""
        return self.period_s > 0 and seconds > PAUSE_PERIODS * self.period_s

    def believed(self, stamp_ns: int) -> bool:
        """Return False for a while after a number has jumped."""
        return self._jump is None or not 0 <= (stamp_ns - self._jump[0]) * 1e-9 <= JUMP_MEMORY_S

    def jump(self, stamp_ns: int, number: int) -> None:
        """Note that a number has jumped from one person to another."""
        if not self.sure:
            self._jump = stamp_ns, number

    @property
    def jumped(self) -> int | None:
        """The number that has jumped, while the numbers are not believed for that; else None."""
        if self._jump is None or self._heard_ns is None or self.believed(self._heard_ns):
            return None
        return self._jump[1]


def same_numbers(rows: Sequence[int | None], columns: Sequence[int]) -> np.ndarray:
    """Return (rows, columns) whether a person's number, None if not known, is that of a detection."""
    known = np.array([number is not None for number in rows], dtype=bool)
    owned = np.array([number or 0 for number in rows], dtype=np.int64)
    same: np.ndarray = (owned[:, None] == np.array(columns, dtype=np.int64)) & known[:, None]
    return same
