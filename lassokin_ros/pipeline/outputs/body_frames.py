"""TF of one person: the frame of the body in the camera frame, and the frames of all joints, each in its parent's."""

from __future__ import annotations

import numpy as np

from lassokin_ros.core.body.rotations import to_quaternion
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.estimate import Estimate
from lassokin_ros.pipeline.frame_result import BODY_FROM_ROOT
from lassokin_ros.pipeline.outputs import rep155
from lassokin_ros.pipeline.outputs.naming import Naming
from lassokin_ros.pipeline.settings import ALL, NodeSettings

BODY = "body"


class BodyFrames:
    """Names and transforms of the TF frames of one person."""

    def __init__(self, skeleton: Skeleton, config: NodeSettings, node: str, person: str = "") -> None:
        """node: full name without the first slash; person: id, empty for one person."""
        naming = Naming.of_person(config, node, person)
        body = naming.link(BODY)
        self._hips = hip_joints(skeleton) if config.rep155 else []
        self._parents = skeleton.parents
        self._under_body = config.rep155
        self.names: list[tuple[str, str]] = [("", body)]
        """(parent, child). An empty parent is the frame of the message, the camera's optical frame."""
        self._with_joints = config.publish_tf == ALL
        self._fixed = np.zeros((0, 3)), np.zeros((0, 4))
        """Positions and quaternions of frames that do not move in their parents."""
        if self._with_joints:
            root = body if config.rep155 else ""
            links = [naming.link_of_joint(joint) for joint in skeleton.joint_names]
            self.names += [(links[i] if i >= 0 else root, link) for i, link in zip(skeleton.parents.tolist(), links)]
            if naming.body_id:
                self._add_rep155(skeleton, naming, links)

    def _add_rep155(self, skeleton: Skeleton, naming: Naming, links: list[str]) -> None:
        """Add REP-155's frames, which are at the joints and have axes of their own."""
        found = rep155.links_of(skeleton.joint_names)
        self.names += [(links[index], naming.link(link)) for link, index, _ in found]
        if found:
            self._fixed = np.zeros((len(found), 3)), to_quaternion(np.stack([axes for _, _, axes in found]))

    def transforms(self, estimate: Estimate) -> tuple[np.ndarray, np.ndarray]:
        """Return positions (k, 3) m and quaternions (k, 4) of the frames `names` in their parents."""
        assert estimate.pose is not None
        positions, orientations = estimate.pose.positions, estimate.pose.orientations
        origin = positions[self._hips].mean(axis=0) if self._hips else positions[0]
        body = orientations[0] @ BODY_FROM_ROOT
        if not self._with_joints:
            return origin[None], to_quaternion(body)[None]
        above, turned = positions[self._parents], orientations[self._parents]
        root = self._parents < 0
        above[root], turned[root] = (origin, body) if self._under_body else (np.zeros(3), np.eye(3))
        inverse = turned.swapaxes(1, 2)
        places = (inverse @ (positions - above)[:, :, None])[:, :, 0]
        quaternions = to_quaternion(np.concatenate([body[None], inverse @ orientations]))
        fixed_places, fixed_quaternions = self._fixed
        return np.concatenate([origin[None], places, fixed_places]), np.concatenate([quaternions, fixed_quaternions])


def hip_joints(skeleton: Skeleton) -> list[int]:
    """Return the indices of both hips, the mean of which is the body's origin in REP-155; empty without both."""
    hips = [i for i, name in enumerate(skeleton.joint_names) if name in ("left_hip", "right_hip")]
    return hips if len(hips) == 2 else []
