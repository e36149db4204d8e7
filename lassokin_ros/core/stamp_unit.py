"""Notice stamps in ms in place of s, and numbers of frames.

With ms every frame is initialised anew, because seconds seem to have passed; with numbers of frames velocities are
wrong, and a person who moves is one who stands.
"""

from __future__ import annotations

import warnings

SHORTEST_S, LONGEST_S = 5.0, 250.0
"""s: steps between observations that are those of a camera of 200 to 4 Hz in ms."""
IN_A_ROW = 10
"""Such steps in a row after which there is a warning."""


class StampUnit:
    """Watches the steps between the stamps of the observations."""

    def __init__(self) -> None:
        self._newest: float | None = None
        self._steps, self._numbers = 0, False

    def add(self, stamp: float) -> None:
        """Use the stamp of an observation, s. Warns once of each."""
        try:
            step = 0.0 if self._newest is None else float(stamp - self._newest)
        except TypeError:  # no number, see gate_observation
            return
        self._newest = stamp
        if step == 0.0 or self._steps > IN_A_ROW:
            return
        is_number = step == 1.0 and stamp == round(stamp)
        if is_number != self._numbers:
            self._steps, self._numbers = 0, is_number
        self._steps = self._steps + 1 if is_number or SHORTEST_S <= step <= LONGEST_S else 0
        if self._steps == IN_A_ROW:
            self._steps += 1
            what = (
                "whole numbers, 1 apart" if is_number else f"{step:g} s apart, so that each frame is initialised anew"
            )
            remedy = "the number of a frame by the frame rate" if is_number else "a time in ms by 1000"
            warnings.warn(
                f"the stamps of {IN_A_ROW} observations in a row are {what}; expected stamps in s: divide {remedy}",
                stacklevel=4,
            )
