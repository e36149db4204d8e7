"""Keypoints of one image as arrays, the result of every keypoint adapter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from msg_adapters.errors import AdapterError

MAX_POINTS = 4096
"""Largest number of keypoints in one message. A message with more is refused before memory is allocated."""

LARGEST_PIXEL = 1e6
"""px: a keypoint with a larger coordinate is missing."""

LARGEST_CONFIDENCE = 2.0
"""Scores from heat maps exceed 1 slightly and are limited to 1. A larger score is invalid or has another unit, such as
percent."""
MOST_INVALID, FEW_INVALID = 3, 0.25
"""Number of scores above LARGEST_CONFIDENCE, and share of the scores of a message, up to which they are single invalid
ones: a body of which few points are visible has few high percentages."""
USUAL_CONFIDENCE, FEWEST_LOGITS = 1.2, 2
"""Scores of which most are larger, or as many as this larger and as many negative, have another unit: logits, which the
sigmoid converts."""
NOT_FOUND = -1.0
"""Score of a point that was not found, in some detectors."""


LONGEST_FRAME_ID = 256
"""Characters. The frame_id is copied to every output and to XML."""


@dataclass(eq=False)
class Keypoints:
    """Keypoints of one image, k points. They are not changed after they were made; `frozen` would double that time.

    Attributes
    ----------
    stamp_ns: ns, of the image. None if the message has no stamp (no header, or a stamp of 0).
    frame_id: the optical frame of the camera; empty if unknown.
    ids: (k,) int, index of each point in the landmark layout.
    xy: (k, 2) px.
    confidence: (k,) 0 to 1.
    persons: (k,) int, the person of each point; None if the message has no person numbers.
    persistent: True if a person keeps the number from message to message (the id of a tracker). False if the numbers
        are valid in this message only.
    depth: (k,) m along the optical axis, NaN = not measured; None if the message has no depth.
    depth_of_surface: True if `depth` was measured on the body's surface, False if it is that of the landmark inside.
    depth_age: s by which `depth` is older than the image of the keypoints.
    landmarks: number of landmarks of the detector's layout, None if the message does not tell.
    depth_note: why depths in the message are not used, in words; empty if they are, or if there are none.
    unplaced: number of people whom the detector reports without keypoints.
    rays: (k, 2) x / z and y / z in the optical frame of the detector's 3D point of each keypoint, NaN = none; None if
        the message has no 3D points of the camera. They do not depend on the size of the image.
    """

    stamp_ns: int | None
    frame_id: str
    ids: np.ndarray
    xy: np.ndarray
    confidence: np.ndarray
    persons: np.ndarray | None = None
    persistent: bool = True
    depth: np.ndarray | None = None
    depth_of_surface: bool = True
    depth_age: float = 0.0
    landmarks: int | None = None
    depth_note: str = ""
    unplaced: int = 0
    rays: np.ndarray | None = None

    @classmethod
    def of_people(
        cls, stamp_ns: int | None, frame_id: str, people: Sequence[tuple[int, np.ndarray, np.ndarray]]
    ) -> Keypoints:
        """Return the keypoints of several people. people: number, pixels (l, 2) and confidence (l,) of each person.

        Numbers below 0 are valid in this image only.
        """
        rows = [np.flatnonzero(confidence > 0) for _, _, confidence in people]
        numbers = [np.full(len(ids), number) for ids, (number, _, _) in zip(rows, people)]
        return cls(
            stamp_ns,
            frame_id,
            np.concatenate([np.zeros(0, dtype=int), *rows]),
            np.concatenate([np.zeros((0, 2)), *(pixels[ids] for ids, (_, pixels, _) in zip(rows, people))]),
            np.concatenate([np.zeros(0), *(scores[ids] for ids, (_, _, scores) in zip(rows, people))]),
            np.concatenate([np.zeros(0, dtype=int), *numbers]),
            persistent=all(number >= 0 for number, _, _ in people),
        )

    @cached_property
    def unscored(self) -> int:
        """Number of points with a position, but with a confidence of 0 or NaN."""
        with np.errstate(invalid="ignore"):
            placed = (np.abs(self.xy) <= LARGEST_PIXEL).all(axis=1) & (self.xy != 0).any(axis=1)
            return int(np.count_nonzero(placed & ~(np.abs(self.confidence) > 0)))

    def as_landmarks(self, count: int, person: int | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Return points (count, 2) px, NaN = missing, and confidence (count,), 0 = missing.

        A point is missing if it is absent, a coordinate is not finite or too large, the confidence is NaN, <= 0 or
        above LARGEST_CONFIDENCE, or the position is exactly (0, 0). Detectors write (0, 0) for points that they did not
        find; Ultralytics' YOLO keeps their confidence.
        person: use the points of this person only. Raises AdapterError if a point has an id outside of the layout
        (wrong layout), if an id is repeated (two people in one message without `person`), or if the confidences have
        another unit, see `_check_unit`.
        """
        return self._placed(self.ids, self._present_of(person), count, count)

    def by_person(self, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return person numbers (p,), points (p, count, 2) and confidence (p, count), see `as_landmarks`."""
        if self.persons is None:
            points, confidence = self.as_landmarks(count)
            return np.zeros(1, dtype=np.int64), points[None], confidence[None]
        numbers, rows = self.persons[:1], self.ids
        if np.count_nonzero(self.persons != numbers) or not len(numbers):
            numbers, index = np.unique(self.persons, return_inverse=True)
            rows = index.reshape(-1) * count + self.ids
        points, confidence = self._placed(rows, self.present, count, len(numbers) * count)
        return numbers, points.reshape(-1, count, 2), confidence.reshape(-1, count)

    def depth_as_landmarks(self, count: int, person: int | None = None) -> np.ndarray | None:
        """Return the depths (count,) m of the points of `as_landmarks`, NaN = not measured; None without any depth."""
        if self.depth is None:
            return None
        chosen = self._present_of(person) & (self.confidence <= LARGEST_CONFIDENCE)
        chosen &= (self.ids >= 0) & (self.ids < count)
        result = np.full(count, np.nan)
        result[self.ids[chosen]] = self.depth[chosen]
        return result

    @cached_property
    def present(self) -> np.ndarray:
        """(k,) bool: True where a point is not missing, see `as_landmarks`."""
        with np.errstate(invalid="ignore"):
            x, y = np.abs(self.xy).T
            farther = np.maximum(x, y)  # NaN if one of them is
            present: np.ndarray = (self.confidence > 0) & (farther <= LARGEST_PIXEL) & (farther > 0)
        return present

    def _present_of(self, person: int | None) -> np.ndarray:
        """(k,) bool: `present`, of one person only if it is given and the message has person numbers."""
        if person is None or self.persons is None:
            return self.present
        of_person: np.ndarray = self.present & (self.persons == person)
        return of_person

    def _placed(self, rows: np.ndarray, present: np.ndarray, count: int, total: int) -> tuple[np.ndarray, np.ndarray]:
        """Return points (total, 2) and confidence (total,), with the usable points in their rows.

        rows: (k,) row of each point. count: number of landmarks in the layout.
        """
        points, confidence = np.empty((total, 2)), np.zeros(total)
        points.fill(np.nan)
        chosen, scores = self._usable(present, count)
        rows = rows.take(chosen)
        points[rows] = self.xy.take(chosen, axis=0)
        confidence[rows] = scores
        if np.count_nonzero(confidence) < len(chosen):
            raise AdapterError("repeated_id", "a keypoint id is repeated; several people need the field 'person'")
        return points, confidence

    def _usable(self, present: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the indices of the present points with a valid confidence, and their confidence, at most 1.

        Raises AdapterError for an unknown id, and if the unit of the confidences is another one.
        """
        chosen = present.nonzero()[0]
        scores = self.confidence.take(chosen)
        if len(scores) and scores[scores.argmax()] > 1.0:
            self._check_unit(scores)
            valid = scores <= LARGEST_CONFIDENCE
            chosen, scores = chosen[valid], np.minimum(scores[valid], 1.0)
        ids = self.ids.take(chosen)
        # Indexing by argmax takes half the time of max() on arrays this small.
        if len(ids) and (ids[ids.argmin()] < 0 or ids[ids.argmax()] >= count):
            wrong = ids[(ids < 0) | (ids >= count)][0]
            raise AdapterError(
                "unknown_id",
                f"keypoint id {wrong}; expected 0 to {count - 1} of the landmark layout{self._hint(ids, count)}",
            )
        return chosen, scores

    def _hint(self, ids: np.ndarray, count: int) -> str:
        """Return what unknown ids seem to be, in words. ids: of the present points. count: landmarks of the layout."""
        if ids.min() == 1 and ids.max() == count:
            return " (they begin at 0)"
        people, rest = divmod(len(self.ids), count)
        if people > 1 and rest == 0 and self.persons is None:
            return f" ({people} people need numbers, or an array the dimensions {people} x {count} x 3)"
        return ""

    def _check_unit(self, scores: np.ndarray) -> None:
        """Raise AdapterError if confidences are no fractions of 1: percentages, logits or sums.

        scores: those of the present points, above 0. The negative ones of other points are compared too: logits are
        negative for points that are not visible.
        """
        large, most = np.count_nonzero(scores > LARGEST_CONFIDENCE), len(scores)
        if 2 * large > most or large > max(MOST_INVALID, FEW_INVALID * most):
            self._refuse_scores(large, most, LARGEST_CONFIDENCE, scores)
        with np.errstate(invalid="ignore"):
            negative = np.count_nonzero((self.confidence < 0) & (self.confidence != NOT_FOUND))
        high = np.count_nonzero(scores > USUAL_CONFIDENCE)
        if 2 * high > most or min(high, negative) >= FEWEST_LOGITS:
            self._refuse_scores(high, most, USUAL_CONFIDENCE, scores)

    @staticmethod
    def _refuse_scores(count: Any, of: int, limit: float, scores: np.ndarray) -> None:
        raise AdapterError(
            "confidence_range",
            f"{count} of {of} confidences are above {limit:g}, up to {scores.max():g}; expected 0 to 1. Rescale them "
            "in the detector: divide percentages by 100, convert logits with the sigmoid 1 / (1 + exp(-x)), and divide "
            "other scores by the largest score of the model",
        )


def frame_name(header: Any) -> str:
    """Return the frame_id of a header without a leading slash, which tf2 has not.

    Raises AdapterError if it is too long or not printable.
    """
    name: str = header.frame_id
    name = name.lstrip("/")
    if len(name) > LONGEST_FRAME_ID or not name.isprintable():
        raise AdapterError(
            "bad_frame_id",
            f"frame_id begins with {ascii(name[:40])} and has {len(name)} characters; expected printable ones, at most "
            f"{LONGEST_FRAME_ID}",
        )
    return name


def header_stamp(header: object) -> int | None:
    """Return the stamp of a header in ns, None for a stamp of 0. Raises AdapterError for an invalid time."""
    stamp = header.stamp  # type: ignore[attr-defined]
    seconds, nanoseconds = int(stamp.sec), int(stamp.nanosec)
    if seconds < 0:
        raise AdapterError("bad_stamp", f"the stamp is {seconds} s and {nanoseconds} ns; expected a time after 1970")
    if nanoseconds >= 1_000_000_000:
        raise AdapterError(
            "bad_stamp",
            f"the stamp is {seconds} s and {nanoseconds} ns; expected nanosec below 1000000000: for a time t in ns, "
            "sec is t // 10**9 and nanosec is t % 10**9",
        )
    return seconds * 1_000_000_000 + nanoseconds or None


def stamp_of(message: Any) -> int | None:
    """Return the stamp of a message, or of Keypoints, in ns; None without a header, a stamp of 0 or an invalid one."""
    if isinstance(message, Keypoints):
        return message.stamp_ns
    try:
        return header_stamp(message.header)
    except (AttributeError, AdapterError):
        return None


def check_count(count: int) -> None:
    """Raise AdapterError if a message has more than MAX_POINTS keypoints."""
    if count > MAX_POINTS:
        raise AdapterError("too_many_points", f"{count} keypoints in one message; expected at most {MAX_POINTS}")
