"""The part of the image that a single-person model gets: the surroundings of the last detection."""

from __future__ import annotations

import numpy as np

TORSO = [5, 6, 11, 12]
"""Shoulders and hips of COCO's keypoints, with which those of Halpe begin, too."""
SURE = 0.3
"""Least score of a point that counts."""
TORSO_REACH, BODY_REACH = 1.9, 1.2
"""Half the side of the region, in multiples of the distance of the torso's and of all points (as MoveNet's demo)."""
LEAST_SIDE = 32
"""px"""
Region = tuple[slice, slice]
"""Rows and columns."""
WHOLE: Region = (slice(None), slice(None))


def region_around(points: np.ndarray, shape: tuple[int, ...]) -> Region:
    """Return the region of the next image around a person; the whole image unless shoulders and hips are seen.

    points: (k, 3), x, y in px and score. shape: (height, width, ...) of the image.
    """
    sure = points[:, 2] > SURE
    shoulders, hips = sure[TORSO[:2]].any(), sure[TORSO[2:]].any()
    if not (shoulders and hips):
        return WHOLE
    seen, torso = points[sure, :2], points[[i for i in TORSO if sure[i]], :2]
    centre = torso.mean(axis=0)
    reach = np.maximum(TORSO_REACH * np.abs(torso - centre).max(axis=0), BODY_REACH * np.abs(seen - centre).max(axis=0))
    reach = np.maximum(reach, reach.max() / 2)  # arms that are about to be lifted stay inside
    limits = np.array([shape[1], shape[0]])
    first = np.clip(np.floor(centre - reach), 0, limits).astype(int)
    last = np.clip(np.ceil(centre + reach), 0, limits).astype(int)
    if (last - first).min() < LEAST_SIDE:
        return WHOLE
    return slice(first[1], last[1]), slice(first[0], last[0])
