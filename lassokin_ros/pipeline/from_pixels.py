"""An observation from a detector's pixels, with the checks of the pipeline, for users of the Python interface."""

from __future__ import annotations

import numpy as np

from lassokin_ros.core.errors import LassokinError
from lassokin_ros.core.observation import Observation
from lassokin_ros.pipeline.camera.lens import Lens
from lassokin_ros.pipeline.placeholders import checked_positions
from lassokin_ros.pipeline.seen import people_in
from msg_adapters.errors import AdapterError
from msg_adapters.keypoints import Keypoints


class KeypointError(LassokinError, ValueError):
    """Keypoints cannot be used: another shape, or another unit."""


def observation_from_pixels(
    stamp: float, points: np.ndarray, lens: Lens, depth: np.ndarray | None = None
) -> Observation:
    """Return the observation of one person in one image.

    stamp: s. points: (l, 3), x and y in px of the raw image, and a confidence from 0 to 1, in the order of the layout.
    A point is missing if it is NaN or (0, 0), if its confidence is 0, or if its position is a placeholder: -1, the
    border of the image, its centre, or a position or coordinate that several points share. lens: of the camera; with
    `lens.size` the border and the centre are known. depth: (l,) m along the optical axis, of the body's surface, NaN =
    not measured.

    Raises KeypointError if an array has another shape or is not of numbers, or if positions or confidences have another
    unit, such as fractions of the image or percent.
    """
    try:
        points = np.asarray(points, dtype=float)
        measured = None if depth is None else np.asarray(depth, dtype=float)
    except (TypeError, ValueError) as error:
        raise KeypointError(f"points or depth are no arrays of numbers: {error}; expected (l, 3) and (l,)") from None
    if points.ndim != 2 or points.shape[1] != 3:
        raise KeypointError(f"points have the shape {points.shape}; expected (l, 3): x, y px, confidence")
    if measured is not None and measured.shape != (len(points),):
        raise KeypointError(f"depth has the shape {measured.shape}; expected ({len(points)},), one per point")
    keypoints = Keypoints(None, "", np.arange(len(points)), points[:, :2], points[:, 2], depth=measured)
    try:
        (found,) = people_in(checked_positions(keypoints, lens.size), len(points), lens)
    except AdapterError as error:
        raise KeypointError(str(error)) from None
    return Observation(
        float(stamp), found.points, found.confidence, lens.focal, depth=found.depth, depth_of_surface=depth is not None
    )
