"""The ends of the limbs relative to their roots, in axes of the chest (arms) and of the pelvis (legs), for ~/limbs."""

from __future__ import annotations

import numpy as np

from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.pipeline.frame_result import BODY_FROM_ROOT, FrameResult

LIMBS = tuple(
    (f"{side}_{end}", f"{side}_{root}")
    for side in ("left", "right")
    for root, ends in (("shoulder", ("elbow", "wrist", "hand")), ("hip", ("knee", "ankle", "foot")))
    for end in ends
)
"""End and root of each entry, by the names of the joints. Joints that a skeleton does not have are left out."""
CHEST = "spine3"
"""Joint whose orientation gives the axes of the arms; the first joint in a skeleton without it. Legs have those of the
first joint, the pelvis."""


class Limbs:
    """Reads the limbs of a skeleton's poses. ends, roots: (k,) indices of joints."""

    def __init__(self, skeleton: Skeleton) -> None:
        names = list(skeleton.joint_names)
        pairs = [(names.index(end), names.index(root)) for end, root in LIMBS if end in names and root in names]
        self.ends, self.roots = [end for end, _ in pairs], [root for _, root in pairs]
        chest = names.index(CHEST) if CHEST in names else 0
        self._axes = [0 if names[root].endswith("hip") else chest for root in self.roots]

    def read(self, frame: FrameResult) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return positions (k, 3) m, their covariance (k, 3, 3) m^2, and which ends are observed (k,) bool.

        The covariance is the sum of those of end and root relative to the pelvis. It is an upper limit while their
        errors have the same sign.
        """
        assert frame.estimate is not None and frame.estimate.pose is not None
        pose, covariance = frame.estimate.pose, frame.uncertainty.covariance
        axes = pose.orientations[self._axes] @ BODY_FROM_ROOT
        apart = pose.positions[self.ends] - pose.positions[self.roots]
        along = np.einsum("kij,ki->kj", axes, apart)
        turned = axes.transpose(0, 2, 1) @ (covariance[self.ends] + covariance[self.roots]) @ axes
        return along, turned, frame.observed[self.ends]
