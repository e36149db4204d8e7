"""The measurements of one frame, in the form that all pieces of evidence read."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from lassokin_ros.core.record import record

WITHOUT_DEPTH = 4.0
"""Factor on the noise from which measured depth is not used, see `FrameData.annealed`."""


@record
class JointDepths:
    """Depths of k joints relative to the middle of the hips, as the depth network estimates them.

    sight: (..., 3) unit vector along which depths are measured, camera frame. depths: (..., k) m.
    whitening: (..., k, k) 1/m: whitening @ (depths - truth) has independent errors of unit scale.
    """

    sight: np.ndarray
    depths: np.ndarray
    whitening: np.ndarray

    def with_weight(self, factor: np.ndarray | float) -> JointDepths:
        """The same depths, with a factor (...,) on the whitening: below 1 they are less certain."""
        return JointDepths(self.sight, self.depths, np.asarray(factor)[..., None, None] * self.whitening)


@record
class FrameData:
    """The measurements of one frame, as arrays.

    points: (..., l, 2) normalised image coordinates, any finite value where the weight is 0.
    weights: (..., l) 1 / standard deviation in that unit, 0 = missing.
    depth: (..., l) m, depth of each landmark along the optical axis; None in a frame without any measured depth.
    depth_weights: (..., l) 1/m, 1 / standard deviation of `depth`, 0 = not measured.
    joint_depths: the network's estimate; None without one.
    Leading axes are people, or hypotheses with different weights.
    """

    points: np.ndarray
    weights: np.ndarray
    depth: np.ndarray | None = None
    depth_weights: np.ndarray | None = None
    joint_depths: JointDepths | None = None

    def prior_weight(self, beside_depth: float) -> np.ndarray | float:
        """(...,) factor on a prior's rows: `beside_depth` if half of the landmarks have a measured depth, else 1.

        The lasso of a frame uses earlier frames only through its start state. The noise of a measured depth is
        independent from frame to frame, but the error of a prior is the same in every frame: with full weight it would
        count again in every frame.
        """
        return 1.0 if self.depth_weights is None else np.where(self.depth_covers, beside_depth, 1.0)

    @property
    def depth_count(self) -> int:
        """Number of measured depths, and of those that the network estimates."""
        measured = 0 if self.depth_weights is None else int(np.count_nonzero(self.depth_weights))
        return measured + (0 if self.joint_depths is None else self.joint_depths.depths.shape[-1])

    @property
    def depth_covers(self) -> np.ndarray | bool:
        """(...,) bool: whether half of the landmarks or more have a measured depth."""
        if self.depth_weights is None:
            return False
        return 2 * np.count_nonzero(self.depth_weights, axis=-1) >= np.count_nonzero(self.weights, axis=-1)

    def annealed(self, factor: float | np.ndarray) -> FrameData:
        """The frame with the keypoints' noise made larger by a factor, (..., 1) if it differs between states.

        Depth is not used while the factor is `WITHOUT_DEPTH` or more. The image places the body first; after that,
        only depths near the body have influence. Otherwise the body could settle between an occluder and the person.
        """
        depth_weights = self.depth_weights
        if depth_weights is not None:
            depth_weights = np.where(np.asarray(factor) < WITHOUT_DEPTH, depth_weights / factor, 0.0)
        return FrameData(self.points, self.weights / factor, self.depth, depth_weights, self.joint_depths)

    @cached_property
    def per_state(self) -> FrameData:
        """The frame for k states per person: each array gains an axis of length 1 after the axis of people."""
        depth, depth_weights, learned = self.depth, self.depth_weights, self.joint_depths
        if depth is not None and depth_weights is not None:
            depth, depth_weights = depth[..., None, :], depth_weights[..., None, :]
        if learned is not None:
            learned = JointDepths(
                learned.sight[..., None, :], learned.depths[..., None, :], learned.whitening[..., None, :, :]
            )
        return FrameData(self.points[..., None, :, :], self.weights[..., None, :], depth, depth_weights, learned)
