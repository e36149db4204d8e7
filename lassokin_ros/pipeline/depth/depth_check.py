"""Whether depth images show the tracked person: noticed from the residuals of the depths at the keypoints.

An image of another camera, of another time, or one that is not registered to the colour image has the background, or
something else, where the keypoints are. Its depths would move the skeleton by centimetres. They are left out until
they fit the person again.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.seen import Seen

APART_M = 0.3
"""m: a depth that differs by more from the tracked body is not of the body. Without depth, the body's own error is
0.1 to 0.2 m."""
WRONG, RIGHT = 0.5, 0.4
"""Shares of keypoints whose depth is behind the body: above the first the images are left out, below the second they
are used again. It is 0.25 with good images (points at the edges of the body), 0.65 or more with wrong ones. A table
that hides the legs is in front of the body."""
MEMORY = 30
"""Number of frames over which the share is averaged."""
LEAST = 15
"""Number of frames before the images are judged."""
LEAST_POINTS = 6
"""Least number of a person's keypoints with a measured depth."""
OTHER_UNIT = 100.0
"""A larger ratio of the measured depths to those of the body is that of mm to m."""
MISFIT = "depth: left out, does not show the person"
"""Key of the count of keypoint messages whose depth image is left out."""

OF_COLOUR_IMAGE = "registered to the colour image, of the same camera, and of the same time"
OF_UNIT = f"in m (32FC1) or in mm (16UC1), because they are more than {OTHER_UNIT:g} times as large as expected"


class DepthCheck:
    """Compares the depths at the keypoints with the tracked bodies. `fault` says why depth is left out."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the images: the camera or the time has changed."""
        self._share, self._frames = 0.0, 0
        self.fault = ""
        """Why depth images are left out, in words; empty if they are used."""

    def update(self, seen: Sequence[Seen], frames: Sequence[FrameResult], camera: str = "") -> None:
        """Judge the depths of the people in one image. frames: its results; camera: its name."""
        people = [depths for frame in frames if (depths := depths_of_person(seen, frame, camera)) is not None]
        if not people:
            return
        behind = [np.mean(measured - expected > APART_M) for measured, expected in people]
        self._frames += 1
        weight = 1.0 / min(self._frames, MEMORY)
        self._share += weight * (float(np.mean(behind)) - self._share)
        if self._frames >= LEAST and self._share > WRONG:
            of_unit = np.mean(np.concatenate([measured > OTHER_UNIT * expected for measured, expected in people])) > 0.5
            self.fault = (
                f"the depth images do not show the person ({100 * self._share:.0f} % of the keypoints are measured more"
                f" than {APART_M:g} m behind the body): depth is not used; check that they are "
                + (OF_UNIT if of_unit else OF_COLOUR_IMAGE)
            )
        elif self._share < RIGHT:
            self.fault = ""


def depths_of_person(
    people: Sequence[Seen], frame: FrameResult, camera: str = ""
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the depths at a person's keypoints: (k,) m measured, (k,) m of the body; None with too few of them.

    people: in the image of a camera; camera: its name.
    """
    estimate = frame.estimate
    if not frame.accepted or estimate is None or estimate.pose is None:
        return None
    image = next((one for one in frame.images if one.camera.name == camera), None)
    seen = None if image is None else next((one for one in people if one.pixels is image.detected), None)
    if image is None or seen is None or seen.sampled is None:
        return None
    own = np.isfinite(seen.sampled) & np.isfinite(seen.points).all(axis=1)
    if np.count_nonzero(own) < LEAST_POINTS:
        return None
    expected = image.camera.into_camera(estimate.pose.landmarks[own])[:, 2]
    return seen.sampled[own], expected
