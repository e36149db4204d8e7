"""What one tracked frame shows to the detectors of a wrong pose."""

from __future__ import annotations

import math

import numpy as np

from lassokin_ros.core.estimate import Estimate
from lassokin_ros.core.observation import HERE, CameraPose
from lassokin_ros.core.record import record

NO_TURN = np.eye(3)


@record
class Signs:
    """What is known of one tracked frame; a figure that is not known is NaN.

    stamp: s. keypoints: (l, 2) in any unit of the image, NaN = missing, as the detector gave them. positions: (n, 3) m,
    joints in the camera frame, the pelvis first. reprojection: error as a share of the person's height in the image.
    cost: per measurement. prior_cost: of the pose prior. network_distance: m, see `FailureModel.update`. visible: (l,)
    bool, keypoints that are used; None for all. camera: name of the camera that saw the keypoints. fixed: as positions,
    but in the frame of the skeleton; None if that is the camera's. rotation: (3, 3) into the camera's frame from one
    that does not turn, if keypoints are normalised; None if the camera does not turn.
    """

    stamp: float
    keypoints: np.ndarray
    positions: np.ndarray
    reprojection: float = math.nan
    cost: float = math.nan
    prior_cost: float = math.nan
    network_distance: float = math.nan
    visible: np.ndarray | None = None
    camera: str = ""
    fixed: np.ndarray | None = None
    rotation: np.ndarray | None = None

    @property
    def used_keypoints(self) -> np.ndarray:
        """(l, 2) the keypoints that are used, NaN = missing."""
        if self.visible is None or np.count_nonzero(self.visible) == len(self.visible):
            return self.keypoints
        return np.where(self.visible[:, None], self.keypoints, np.nan)


def signs_of(
    estimate: Estimate,
    points: np.ndarray,
    focal: float,
    height: float,
    camera: CameraPose = HERE,
    frame_turn: np.ndarray = NO_TURN,
) -> Signs:
    """Return what an accepted estimate shows.

    points: (l, 2) normalised image coordinates of the detector's keypoints. focal: px per normalised unit. height: m,
    of the skeleton. camera: that of the points. frame_turn: (3, 3) by which the frame of the skeleton has turned.
    """
    assert estimate.pose is not None
    positions = camera.into_camera(estimate.pose.positions)
    alone = estimate.cameras == 1 and not estimate.depth_covers  # the failure model is that of one camera without depth
    return Signs(
        estimate.stamp,
        points,
        positions,
        estimate.reprojection_px / focal * float(positions[0, 2]) / height,
        estimate.cost / max(estimate.measurements, 1),
        estimate.prior_cost,
        estimate.network_distance if alone else math.nan,
        estimate.visible,
        camera.name,
        None if camera.is_identity else estimate.pose.positions,
        None if camera.is_identity else camera.rotation @ frame_turn,
    )
