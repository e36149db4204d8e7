"""An observation from a detector's pixels, with the checks of the session, for users of the Python interface."""

from __future__ import annotations

import numpy as np

from lassokin_ros.core.errors import LassokinError
from lassokin_ros.core.image.gating import LATEST_STAMP
from lassokin_ros.core.observation import HERE, CameraPose, Observation
from lassokin_ros.pipeline.camera.lens import Lens
from lassokin_ros.pipeline.input_checks.image_size import refuse_outside
from lassokin_ros.pipeline.input_checks.placeholders import checked_positions
from lassokin_ros.pipeline.seen import people_in
from msg_adapters.errors import AdapterError
from msg_adapters.keypoints import Keypoints

FARTHEST_M = 100.0
"""m: depths of which most are larger have another unit. No depth camera measures so far."""


class KeypointError(LassokinError, ValueError):
    """Keypoints or their stamp cannot be used: another shape, or another unit."""


def observation_from_pixels(
    stamp: float,
    points: np.ndarray,
    lens: Lens,
    depth: np.ndarray | None = None,
    camera: CameraPose = HERE,
) -> Observation:
    """Return the observation of one person in one image.

    stamp: s, such as frame / rate or time.time(). points: (l, 3), x and y in px of the raw image, and a confidence from
    0 to 1, in the order of the layout; an array without any value is an image without anybody. A point is missing if it
    is NaN or (0, 0), if its confidence is 0, or if its position is a placeholder: -1, the border of the image, its
    centre, or a position or coordinate that several points share. lens: of the camera; with `lens.size` the border and
    the centre are known. depth: (l,) m along the optical axis, of the body's surface, NaN = not measured. camera: which
    of several cameras, and where.

    Raises KeypointError if an array has another shape or is not of numbers, or if the stamp, positions, confidences or
    depths have another unit, such as ms, fractions of the image, percent or mm.
    """
    seconds = _seconds(stamp)
    points, measured = _arrays(points, depth)
    if points.size == 0:
        return Observation(seconds, np.empty((0, 2)), np.empty(0), lens.focal, camera=camera)
    keypoints = Keypoints(None, "", np.arange(len(points)), points[:, :2], points[:, 2], depth=measured)
    try:
        keypoints = checked_positions(keypoints, lens)
        refuse_outside(keypoints, lens)
        (found,) = people_in(keypoints, len(points), lens)
    except AdapterError as error:
        raise KeypointError(str(error)) from None
    return Observation(
        seconds,
        found.points,
        found.confidence,
        lens.focal,
        depth=found.depth,
        depth_of_surface=depth is not None,
        camera=camera,
    )


def _arrays(given: np.ndarray, depth: np.ndarray | None) -> tuple[np.ndarray, np.ndarray | None]:
    """Return the points (l, 3) of one person, or none, and the depth (l,). Raises KeypointError."""
    try:
        points = np.asarray(given, dtype=float)
        measured = None if depth is None else np.asarray(depth, dtype=float)
    except (TypeError, ValueError) as error:
        raise KeypointError(f"points or depth are no arrays of numbers: {error}; expected (l, 3) and (l,)") from None
    if points.size == 0:
        return points, measured
    if points.ndim == 3 and len(points) == 1:
        points = points[0]
    if points.ndim != 2 or points.shape[1] != 3:
        several = ", of one person" if points.ndim == 3 else ""
        raise KeypointError(f"points have the shape {points.shape}; expected (l, 3){several}: x, y px, confidence")
    if measured is not None and measured.shape != (len(points),):
        raise KeypointError(f"depth has the shape {measured.shape}; expected ({len(points)},), one per point")
    if measured is not None and np.count_nonzero(measured > FARTHEST_M) > 0.5 * np.count_nonzero(measured > 0):
        raise KeypointError(
            f"most depths are above {FARTHEST_M:g} m, up to {np.nanmax(measured):g}; expected m: divide mm by 1000"
        )
    return points, measured


def _seconds(stamp: object) -> float:
    """Return a stamp as a number of seconds. Raises KeypointError if it is none, or has another unit."""
    try:
        seconds = float(stamp)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise KeypointError(
            f"the stamp is {stamp!r}, of type {type(stamp).__name__}; expected a number of seconds: for a datetime t "
            "t.timestamp(), for a ROS stamp sec + 1e-9 * nanosec"
        ) from None
    if seconds > LATEST_STAMP:
        raise KeypointError(f"the stamp is {seconds:g} s; expected s: divide a time in ms by 1e3, in ns by 1e9")
    return seconds
