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
FEWEST_ALIKE = 3
"""Keypoints that share a coordinate from which on they are placeholders, if the detector does not round, or outside of
the image."""
FEWEST_ROUNDED, MOST_OF = 5, 0.5
"""For rounded positions inside the image: the same number, and the share of the person's keypoints."""


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
        wrong = present & (_is_fixed(keypoints.xy, size) | _alike(keypoints, present, size))
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
    people, numbers = [confident], keypoints.persons
    if numbers is not None:
        people = [confident & (numbers == number) for number in np.unique(numbers[confident])]
    count = keypoints.unplaced
    for own in people:
        if np.count_nonzero(own):
            count += bool(np.count_nonzero(own & kept.present)) or bool(
                np.ptp(keypoints.xy[own], 0).max() >= SMALLEST_PX
            )
    return count


def _is_usual(keypoints: Keypoints, size: tuple[int, int]) -> bool:
    """Return True if the keypoints surely hold neither placeholders nor fractions, in a fifth of the tests' time."""
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


@lru_cache(maxsize=16)
def _inside(size: tuple[int, int]) -> tuple[list[float], list[float], frozenset[float], frozenset[float]]:
    """Return the inner ends (x, y) of the bands of `_fixed_places`, and x and y of its centres, px."""
    bands, centres = _fixed_places(size)
    x, y = centres[:, 0].T.tolist()
    return bands[0, 1].tolist(), bands[1, 0].tolist(), frozenset(x), frozenset(y)


def _is_fixed(xy: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """(k,) bool: -1, the same negative number in both coordinates (px, or of the sides), the border, or the centre."""
    x, y = xy[:, 0], xy[:, 1]
    bands, centres = _fixed_places(size)
    fixed: np.ndarray = (x == -1.0) | (y == -1.0) | ((x < 0) & (x == y))
    if min(size) > 0:
        fixed |= (x < 0) & (x * size[1] == y * size[0])
    fixed |= ((xy >= bands[:, :1]) & (xy <= bands[:, 1:])).any(axis=(0, 2))
    return fixed | (xy == centres).all(axis=2).any(axis=0)


def _alike(keypoints: Keypoints, present: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """(k,) bool: keypoints of one person at the same position, or with the same x or y, as others."""
    result = np.zeros(len(present), dtype=bool)
    rows = np.flatnonzero(present)
    people = np.zeros(len(present)) if keypoints.persons is None else keypoints.persons
    for person in np.unique(people[rows]):
        own = rows[people[rows] == person]
        xy = keypoints.xy[own]
        if np.ptp(xy, axis=0).max() >= SMALLEST_PX:
            _, index, counts = np.unique(xy, axis=0, return_inverse=True, return_counts=True)
            result[own] = (counts[index.reshape(-1)] >= REPEATED) | is_shared(xy, size)
    return result


def is_shared(xy: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """(k,) bool: points of one person, (k, 2) px, with an x or y that several have, which rounding does not explain.

    A detector that rounds has whole numbers, or others that agree. size: (width, height) px of the image; 0 = unknown.
    """
    shared = np.zeros(len(xy), dtype=bool)
    for values, length in zip(xy.T, size):
        different, counts = np.unique(values, return_counts=True)
        for value in different[counts >= FEWEST_ALIKE]:
            same, others = values == value, values[values != value]
            count, outside = np.count_nonzero(same), value < 0 or 0 < length < value
            are_most = count == len(same) or count >= max(FEWEST_ROUNDED, MOST_OF * len(same))
            rounded = len(np.unique(others)) < len(others) or np.array_equal(others, np.round(others))
            if outside or are_most or not rounded:
                shared |= same
    return shared
