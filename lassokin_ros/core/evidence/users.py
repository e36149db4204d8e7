"""A user's own evidence in the tracker: a fault in it is named once, and the evidence is left out from then on."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from lassokin_ros.core.body.proportions import LengthMotion
from lassokin_ros.core.errors import ConfigurationError
from lassokin_ros.core.evidence.evidence import EvaluatedState, Evidence, LinearisationPoint
from lassokin_ros.core.image.frame_data import FrameData

Answer = TypeVar("Answer")
LARGEST_NUMBER = 1e5
"""Largest number in a row, and on its right side; with larger ones the lasso's answer is not certified."""


class UsersEvidence(Evidence):
    """Passes calls to an `Evidence` of the user, and replaces the answers of a faulty one by zeros: no information."""

    def __init__(self, evidence: Evidence) -> None:
        """Raises ConfigurationError if the evidence has no name, or no valid number of rows."""
        name, count = getattr(evidence, "name", None), getattr(evidence, "count", None)
        if not isinstance(name, str) or not name:
            raise ConfigurationError(f"evidence {type(evidence).__name__} has name {name!r}; expected a text")
        if not isinstance(count, int) or count < 1:
            raise ConfigurationError(f"evidence '{name}' has count {count!r}; expected its number of rows, 1 or more")
        self.name, self.count, self._evidence = name, count, evidence
        self.fault = ""
        """What was wrong with the evidence, empty as long as it is used."""

    def present(self, frame: FrameData) -> bool:
        """See Evidence.present; False after a fault."""
        return self._tried(lambda: bool(self._evidence.present(frame)), False)

    def linearise(self, about: LinearisationPoint, columns: np.ndarray, z: np.ndarray) -> None:
        """See Evidence.linearise."""

        def filled() -> bool:
            columns[...], z[...] = np.nan, np.nan  # what the user's code does not fill is noticed
            self._evidence.linearise(about, columns, z)
            largest = np.abs(np.append(columns, z)).max()
            if not largest <= LARGEST_NUMBER:
                raise ValueError(
                    f"linearise left {largest:g} in rows or z; expected finite numbers up to {LARGEST_NUMBER:g}"
                )
            return True

        if not self._tried(filled, False):
            columns[...], z[...] = 0.0, 0.0

    def cost(self, states: EvaluatedState, frame: FrameData) -> np.ndarray:
        """See Evidence.cost."""
        shape = states.state.translation.shape[:-1]

        def computed() -> np.ndarray:
            cost = np.asarray(self._evidence.cost(states, frame), dtype=float)
            if cost.shape != shape or not np.isfinite(cost).all():
                raise ValueError(f"cost has shape {cost.shape} or is not finite; expected {shape}")
            return cost

        return self._tried(computed, np.zeros(shape))

    def length_rows(
        self, columns: np.ndarray, states: EvaluatedState, frame: FrameData, motion: LengthMotion
    ) -> np.ndarray:
        """See Evidence.length_rows."""

        def computed() -> np.ndarray:
            rows = np.asarray(self._evidence.length_rows(columns, states, frame, motion), float)
            if not np.isfinite(rows).all():
                raise ValueError("length_rows left rows that are not finite")
            return np.broadcast_to(rows, (self.count, motion.joints.shape[-1]))

        return self._tried(computed, np.zeros((self.count, motion.joints.shape[-1])))

    def _tried(self, answer: Callable[[], Answer], otherwise: Answer) -> Answer:
        """The answer of the user's code; after a fault, and if it raises, the one given in its place."""
        if self.fault:
            return otherwise
        try:
            return answer()
        except Exception as error:  # a user's code raises anything
            self.fault = f"evidence '{self.name}' is left out: {type(error).__name__}: {error}"
            return otherwise
