"""Keypoints of one image as arrays: what every keypoint adapter returns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from msg_adapters.errors import AdapterError

MAX_POINTS = 4096
"""Keypoints in one message; more are refused before memory is taken."""

LARGEST_PIXEL = 1e6
"""px: a coordinate beyond this counts as missing."""

LARGEST_CONFIDENCE = 2.0
"""Scores from heat maps overshoot 1 a little and are cut to 1; beyond this the unit is another (percent, say)."""


LONGEST_FRAME_ID = 256
"""Characters; it goes into every output and into XML."""


@dataclass(frozen=True, eq=False)
class Keypoints:
    """Keypoints of one image, k points.

    Attributes
    ----------
    stamp_ns: the image's, ns; None when the message has no stamp (no header, or a stamp of zero).
    frame_id: the camera's optical frame; empty when the message does not say.
    ids: (k,) int, index of each point in the landmark layout.
    xy: (k, 2) px.
    confidence: (k,) 0 to 1.
    persons: (k,) int, the person to whom each point belongs; None when the message does not say.
    persistent: True when a person keeps the number from message to message (a tracker's id); False when the numbers only
        tell the people of this message apart.
    """

    stamp_ns: int | None
    frame_id: str
    ids: np.ndarray
    xy: np.ndarray
    confidence: np.ndarray
    persons: np.ndarray | None = None
    persistent: bool = True

    def as_landmarks(self, count: int, person: int | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Points (count, 2) px, NaN where missing, and confidence (count,), 0 where missing.

        Missing is: absent, a coordinate that is not finite or not a pixel's, a confidence that is NaN, 0 or less, and
        exactly (0, 0): detectors put there what they have not found, Ultralytics' YOLO with its confidence left.
        person: take this person's points only. Raises AdapterError when a point that is not missing has an id that
        the layout does not have (the layout is the wrong one), when an id stands twice (two people in one message
        without `person`), or when a confidence is no fraction of 1: such a frame is refused, never guessed at.
        """
        present = self.present
        if person is not None and self.persons is not None:
            present &= self.persons == person
        return self._placed(self.ids, present, count, count)

    def by_person(self, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The people's numbers (p,), and points (p, count, 2) and confidence (p, count) of each: see `as_landmarks`."""
        if self.persons is None:
            points, confidence = self.as_landmarks(count)
            return np.zeros(1, dtype=np.int64), points[None], confidence[None]
        numbers, index = np.unique(self.persons, return_inverse=True)
        places = index.reshape(-1) * count + self.ids
        points, confidence = self._placed(places, self.present, count, len(numbers) * count)
        return numbers, points.reshape(-1, count, 2), confidence.reshape(-1, count)

    @property
    def present(self) -> np.ndarray:
        """(k,) bool: what is not missing, see `as_landmarks`."""
        with np.errstate(invalid="ignore"):
            near = np.abs(self.xy) <= LARGEST_PIXEL
            present: np.ndarray = (self.confidence > 0) & near[:, 0] & near[:, 1] & self.xy.any(axis=1)
        return present

    def _placed(self, places: np.ndarray, present: np.ndarray, count: int, rows: int) -> tuple[np.ndarray, np.ndarray]:
        """Points (rows, 2) and confidence (rows,), the present ones at their places (k,); count: the layout's."""
        points, confidence = np.full((rows, 2), np.nan), np.zeros(rows)
        chosen = present.nonzero()[0]
        if len(chosen) == 0:
            return points, confidence
        ids, scores, places = self.ids.take(chosen), self.confidence.take(chosen), places.take(chosen)
        if ids.min() < 0 or ids.max() >= count:
            wrong = ids[(ids < 0) | (ids >= count)][0]
            raise AdapterError("unknown_id", f"keypoint id {wrong}; expected 0 to {count - 1} of the landmark layout")
        points[places], confidence[places] = self.xy.take(chosen, axis=0), np.minimum(scores, 1.0)
        if np.count_nonzero(confidence) < len(chosen):
            raise AdapterError("repeated_id", "a keypoint id stands twice; several people need the field 'person'")
        if scores.max() > LARGEST_CONFIDENCE:
            raise AdapterError("confidence_range", f"a confidence is {scores.max():g}; expected 0 to 1")
        return points, confidence


def frame_name(header: Any) -> str:
    """A header's frame_id. Raises AdapterError for one that no frame can have: too long, or not printable."""
    name: str = header.frame_id
    if len(name) > LONGEST_FRAME_ID or not name.isprintable():
        raise AdapterError(
            "bad_frame_id",
            f"frame_id begins with {ascii(name[:40])} and has {len(name)} characters; expected printable ones, at most "
            f"{LONGEST_FRAME_ID}",
        )
    return name


def header_stamp(header: object) -> int | None:
    """A header's stamp in ns, None for a stamp of zero. Raises AdapterError for one that is no time."""
    stamp = header.stamp  # type: ignore[attr-defined]
    seconds, nanoseconds = int(stamp.sec), int(stamp.nanosec)
    if seconds < 0 or nanoseconds >= 1_000_000_000:
        raise AdapterError("bad_stamp", f"the stamp is {seconds} s and {nanoseconds} ns; expected a time after 1970")
    return seconds * 1_000_000_000 + nanoseconds or None


def check_count(count: int) -> None:
    """Raise AdapterError when a message holds more keypoints than a picture can need."""
    if count > MAX_POINTS:
        raise AdapterError("too_many_points", f"{count} keypoints in one message; expected at most {MAX_POINTS}")
