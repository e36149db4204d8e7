"""Remove coordinates that stand in place of a measurement.

Detectors write such placeholders for keypoints that they did not find, often with a confidence above 0: the border of
the image (clamped coordinates), (-1, -1), the centre of the image, one position for several keypoints, or one x or y
for several keypoints (see `is_shared`).

Measured positions agree in one coordinate only where a detector rounds them: to whole pixels, or to the cells of a
heat map. Then few keypoints agree by chance, and they are measurements.

A clamped point is at the border or beyond. It is treated as missing. Its use as a bound on one side would hardly
improve the pose, see docs/faults.md.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from lassokin_ros.pipeline.camera.lens import Lens
from msg_adapters.errors import AdapterError
from msg_adapters.keypoints import Keypoints

PLACEHOLDERS = "placeholder coordinates"
"""Key of the count of messages that have them."""
BORDER_PX = 0.01
"""px: tolerance of clamped coordinates outside of the image, and inside if its size is unknown."""
BORDER = 0.005
"""Of the side's length: points nearer to a border, inside, are clamped. Detectors clamp to the middle of a pixel, to a
pixel of a smaller image, or to a cell of a heat map."""
REPEATED = 3
"""Keypoints of one person at the same position are placeholders from this number on. Two may coincide: detectors
place left and right on one limb."""
FEWEST_FRACTIONS = 4
"""Keypoints from which on coordinates are recognised as fractions of the image size."""
LARGEST_FRACTION = 3.0
"""Of the side's length: largest coordinate of such keypoints. Limbs may be estimated outside of the image."""
LEAST_FRACTION = 0.01
"""Of the side's length: smallest extent of such keypoints. A few placeholders can be less than a pixel apart, too."""
LARGEST_PERCENT = 100.0
"""Percent of the image: largest coordinate of such keypoints, inside."""
MOST_OUTSIDE = 0.25
"""Share of a message's keypoints outside of 0 to 100 from which on they are px: a person in the corner of the image."""
LEAST_PERCENT = 15.0
"""Percent: smallest height or width of a person by which percentages are recognised. As px they are in a corner."""
SMALLEST_IN_PERCENT = 200
"""px: percentages are recognised in images with longer sides."""
SMALLEST_PX = 50.0
"""px: in a person smaller than this, eyes and nose can have the same rounded position."""


def checked_positions(keypoints: Keypoints, lens: Lens) -> Keypoints:
    """Return the keypoints without placeholders. Raises AdapterError for fractions or percent in place of px.

    lens: of the camera; it remembers that larger coordinates than 100 were seen, which are no percentages.
    """
    if _is_usual(keypoints, lens.size):
        lens.in_pixels = True
        return keypoints
    refuse_fractions(keypoints, lens.size)
    kept = without_placeholders(keypoints, lens.size)
    if not lens.in_pixels:
        lens.in_pixels = _refuse_percent(kept, lens.size)
    return kept


def refuse_fractions(keypoints: Keypoints, size: tuple[int, int]) -> None:
    """Raise AdapterError if the coordinates are fractions of the image size in place of px.

    size: (width, height) px of the image; 0 = unknown.
    """
    xy = keypoints.xy.compress(keypoints.present, axis=0)
    if len(xy) < FEWEST_FRACTIONS or np.abs(xy).max() > LARGEST_FRACTION or np.ptp(xy, axis=0).max() < LEAST_FRACTION:
        return
    if 2 * np.count_nonzero(((xy >= 0.0) & (xy <= 1.0)).all(axis=1)) <= len(xy):
        return  # most are not inside the image: placeholders, such as -1
    width, height = (f" ({side})" if side else "" for side in size)
    raise AdapterError(
        "fractions",
        f"most coordinates are between 0 and 1; expected px: multiply x by the image's width{width} and y by its "
        f"height{height}",
    )


def _refuse_percent(keypoints: Keypoints, size: tuple[int, int]) -> bool:
    """Return True if the coordinates are px for certain. Raises AdapterError if they are percent of the image size.

    size: (width, height) px of the image; 0 = unknown.
    """
    xy = keypoints.xy.compress(keypoints.present, axis=0)
    if min(size) < SMALLEST_IN_PERCENT or len(xy) < FEWEST_FRACTIONS:
        return False
    inside = ((xy >= 0.0) & (xy <= LARGEST_PERCENT)).all(axis=1)
    if np.count_nonzero(~inside) > MOST_OUTSIDE * len(xy):
        return True
    if np.ptp(xy, axis=0).max() < LEAST_PERCENT:
        return False
    raise AdapterError(
        "percent",
        f"most coordinates are between 0 and 100 in an image of {size[0]} x {size[1]} px, as percent of it are; "
        f"expected px: multiply x by {size[0] / 100:g} and y by {size[1] / 100:g}",
    )


def without_placeholders(keypoints: Keypoints, size: tuple[int, int]) -> Keypoints:
    """Return the keypoints with placeholders as missing points (NaN), or the same object if there are none.

    size: (width, height) px of the image; 0 = unknown.
    """
    present = keypoints.present
    with np.errstate(invalid="ignore"):
        wrong = _sentinel(keypoints.xy, size) | _at_fixed_place(keypoints.xy, size) | _alike(keypoints, present, size)
        wrong &= present
    if np.count_nonzero(wrong) == 0:
        return keypoints
    xy = keypoints.xy.copy()
    xy[wrong] = np.nan
    return replace(keypoints, xy=xy)


def people_shown(keypoints: Keypoints, kept: Keypoints, min_confidence: float) -> int:
    """Return the number of people in an image, by keypoints of at least `min_confidence`.

    keypoints: as in the message; kept: without placeholders. A person of placeholders alone, such as one at the border
    of the image who is very near, counts if they are far apart: detectors write nobody as one position.
    """
    confident = keypoints.present & (keypoints.confidence >= min_confidence)
    found, numbers = [confident], keypoints.persons
    if numbers is not None:
        found = [confident & (numbers == number) for number in np.unique(numbers[confident])]
    return keypoints.unplaced + sum(_is_somebody(keypoints, kept, own) for own in found)


def _is_somebody(keypoints: Keypoints, kept: Keypoints, own: np.ndarray) -> bool:
    """Return True if the keypoints `own` (k,) bool are those of a person, see `people_shown`."""
    if np.count_nonzero(own) == 0:
        return False
    return bool(np.count_nonzero(own & kept.present)) or float(np.ptp(keypoints.xy[own], axis=0).max()) >= SMALLEST_PX


def _is_usual(keypoints: Keypoints, size: tuple[int, int]) -> bool:
    """Return True if the keypoints surely hold neither placeholders nor fractions. This takes a fifth of the time of
    the full tests.
    """
    x, y = keypoints.xy.compress(keypoints.present, axis=0).T.tolist()  # sets and minima take half of numpy's time
    if not x:
        return True
    if min(size) <= 0 or (max(x) <= LARGEST_PERCENT and max(y) <= LARGEST_PERCENT):
        return False
    (near_x, near_y), (far_x, far_y), centres_x, centres_y = _inside(size)
    inside = near_x < min(x) and max(x) < far_x and near_y < min(y) and max(y) < far_y
    different = set(x)
    if not inside or len(x) - len(different) >= REPEATED - 1 or len(y) - len(set(y)) >= REPEATED - 1:
        return False
    return different.isdisjoint(centres_x) and centres_y.isdisjoint(y)


@lru_cache(maxsize=16)
def _inside(size: tuple[int, int]) -> tuple[list[float], list[float], frozenset[float], frozenset[float]]:
    """Return the inner ends (x, y) of the bands of `_fixed_places`, and x and y of its centres, px."""
    bands, centres = _fixed_places(size)
    x, y = centres[:, 0].T.tolist()
    return bands[0, 1].tolist(), bands[1, 0].tolist(), frozenset(x), frozenset(y)


def _sentinel(xy: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """(k,) bool: -1 in a coordinate, or the same negative number in both, in px or as fractions of the image size."""
    x, y = xy[:, 0], xy[:, 1]
    result: np.ndarray = (x == -1.0) | (y == -1.0) | ((x < 0) & (x == y))
    if min(size) > 0:
        result |= (x < 0) & (x * size[1] == y * size[0])
    return result


@lru_cache(maxsize=16)
def _fixed_places(size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Return the bands of the borders (b, 2, 2), from and to, and the centres (c, 1, 2) of an image, px.

    size: (width, height) px, 0 = unknown.
    """
    if min(size) <= 0:
        return np.array([[[-BORDER_PX] * 2, [BORDER_PX] * 2]]), np.full((1, 1, 2), np.inf)
    far = np.array(size, dtype=float)
    near = BORDER * far
    bands = [[0 * far - BORDER_PX, near], [far - 1 - near, far + BORDER_PX]]
    return np.array(bands), np.stack([0.5 * (far - 1), 0.5 * far, np.floor(0.5 * far)])[:, None]


def _at_fixed_place(xy: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """(k,) bool: at the border, see BORDER, or exactly in the centre of the image."""
    bands, centres = _fixed_places(size)
    on_border = ((xy >= bands[:, :1]) & (xy <= bands[:, 1:])).any(axis=(0, 2))
    result: np.ndarray = on_border | (xy == centres).all(axis=2).any(axis=0)
    return result


def _alike(keypoints: Keypoints, present: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """(k,) bool: keypoints of one person at the same position, or with the same x or y, as others."""
    result = np.zeros(len(present), dtype=bool)
    rows = np.flatnonzero(present)
    people = np.zeros(len(present)) if keypoints.persons is None else keypoints.persons
    for person in np.unique(people[rows]):
        own = rows[people[rows] == person]
        xy = keypoints.xy[own]
        if np.ptp(xy, axis=0).max() >= SMALLEST_PX:
            result[own] = _repeated(xy) | is_shared(xy, size)
    return result


def _repeated(xy: np.ndarray) -> np.ndarray:
    """(k,) bool: at least REPEATED of the points (k, 2) have this position."""
    _, index, counts = np.unique(xy, axis=0, return_inverse=True, return_counts=True)
    repeated: np.ndarray = counts[index.reshape(-1)] >= REPEATED
    return repeated


FEWEST_ALIKE = 3
"""Keypoints that share a coordinate from which on they are placeholders, if the detector does not round, or outside of
the image."""
FEWEST_ROUNDED, MOST_OF = 5, 0.5
"""For rounded positions inside the image: the same number, and the share of the person's keypoints."""


def is_shared(xy: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """(k,) bool: points of one person, (k, 2) px, with a coordinate that is a placeholder.

    size: (width, height) px of the image; 0 = unknown.
    """
    shared = np.zeros(len(xy), dtype=bool)
    for values, length in zip(xy.T, size):
        shared |= _shared(values, length)
    return shared


def _shared(values: np.ndarray, length: int) -> np.ndarray:
    """(k,) bool: the coordinates (k,) that are placeholders. length: px of the image's side; 0 = unknown."""
    shared = np.zeros(len(values), dtype=bool)
    different, counts = np.unique(values, return_counts=True)
    for value in different[counts >= FEWEST_ALIKE]:
        same = values == value
        outside = value < 0 or 0 < length < value
        if outside or _are_most(same) or not _rounded(values[~same]):
            shared |= same
    return shared


def _are_most(same: np.ndarray) -> bool:
    """Return True if so many of the points (k,) share a coordinate that rounding does not explain it."""
    count = np.count_nonzero(same)
    return bool(count == len(same) or count >= max(FEWEST_ROUNDED, MOST_OF * len(same)))


def _rounded(values: np.ndarray) -> bool:
    """Return True if a detector may have rounded the coordinates: some agree, or all are whole numbers."""
    return len(np.unique(values)) < len(values) or bool(np.array_equal(values, np.round(values)))
