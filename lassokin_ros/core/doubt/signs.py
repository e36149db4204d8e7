"""What one tracked frame shows to the detectors of a wrong pose."""

from __future__ import annotations

import math

import numpy as np

from lassokin_ros.core.estimate import Estimate
from lassokin_ros.core.observation import HERE, CameraPose
from lassokin_ros.core.record import record


@record
class Signs:
    """What is known of one tracked frame; a figure that is not known is NaN.

    stamp: s. keypoints: (l, 2) in any unit of the image, NaN = missing, as the detector gave them. positions: (n, 3) m,
    joints in the camera frame, the pelvis first. reprojection: error as a share of the person's height in the image.
    cost: per measurement. prior_cost: of the pose prior. network_distance: m, see `FailureModel.update`. observed: (n,)
    bool, joints that keypoints observe; None if unknown. camera: name of the camera that saw the keypoints. fixed: as
    positions, but in the frame of the skeleton; None if that is the camera's.
    """

    stamp: float
    keypoints: np.ndarray
    positions: np.ndarray
    reprojection: float = math.nan
    cost: float = math.nan
    prior_cost: float = math.nan
    network_distance: float = math.nan
    observed: np.ndarray | None = None
    camera: str = ""
    fixed: np.ndarray | None = None


def signs_of(
    estimate: Estimate,
    points: np.ndarray,
    focal: float,
    height: float,
    observed: np.ndarray | None = None,
    camera: CameraPose = HERE,
) -> Signs:
    """Return what an accepted estimate shows.

    points: (l, 2) normalised image coordinates of the detector's keypoints. focal: px per normalised unit. height: m,
    of the skeleton. observed: (n,) bool, see `Tracker.observed`. camera: that of the points.
    """
    assert estimate.pose is not None and estimate.visible is not None
    positions = camera.into_camera(estimate.pose.positions)
    return Signs(
        estimate.stamp,
        np.where(estimate.visible[:, None], points, np.nan),
        positions,
        estimate.reprojection_px / focal * float(positions[0, 2]) / height,
        estimate.cost / max(estimate.measurements, 1),
        estimate.prior_cost,
        estimate.network_distance if estimate.cameras == 1 else math.nan,  # the failure model is that of one camera
        observed,
        camera.name,
        None if camera.is_identity else estimate.pose.positions,
    )
