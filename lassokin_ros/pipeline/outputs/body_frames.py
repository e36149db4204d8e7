"""Names and frames of one person: links and joints of the URDF, TF frames, and those of REP-155 (docs/rep155.md).

Frames and joints of a body of REP-155 end with `_<id>`. It names fifteen frames below `body_<id>`, with the axes of the
package human_description: x to the front and z up for a person who stands with hanging arms.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lassokin_ros.core.body.rotations import to_quaternion
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.estimate import Estimate
from lassokin_ros.pipeline.frame_result import BODY_FROM_ROOT
from lassokin_ros.pipeline.settings import ALL, NodeSettings

_TRUNK = BODY_FROM_ROOT
_LEFT_ARM = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
_RIGHT_ARM = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])

LINKS: dict[str, tuple[str, np.ndarray]] = {
    "waist": ("spine1", _TRUNK),
    "torso": ("spine3", _TRUNK),
    "head": ("head", _TRUNK),
    **{
        f"{side[0]}_{name}": (f"{side}_{name}", _TRUNK)
        for side in ("left", "right")
        for name in ("hip", "knee", "ankle")
    },
    **{f"l_{name}": (f"left_{name}", _LEFT_ARM) for name in ("shoulder", "elbow", "wrist")},
    **{f"r_{name}": (f"right_{name}", _RIGHT_ARM) for name in ("shoulder", "elbow", "wrist")},
}
"""REP-155's link -> joint of the skeleton, and the axes of the link as columns in the frame of that joint (x to the
person's left, y up, z to the front in the T-pose). The link is at the joint."""

JOINTS: dict[str, tuple[str, float]] = {
    "l_knee": ("left_knee_x", -1.0),
    "r_knee": ("right_knee_x", -1.0),
    "l_elbow": ("left_elbow_y", -1.0),
    "r_elbow": ("right_elbow_y", 1.0),
}
"""REP-155's joint -> angle of the skeleton and its sign. The joints that have the same zero and axis in both."""


def links_of(joints: Sequence[str]) -> list[tuple[str, int, np.ndarray]]:
    """Return REP-155's links of a skeleton with these joints: name, index of the joint, axes (3, 3)."""
    names = list(joints)
    return [(link, names.index(joint), axes) for link, (joint, axes) in LINKS.items() if joint in names]


class MappedJoints:
    """The joint states of a body under REP-155: those of the URDF, then the mapped ones."""

    def __init__(self, names: Sequence[str], person: str) -> None:
        """names: of the joints, without a suffix."""
        mapped = {name: (names.index(angle), sign) for name, (angle, sign) in JOINTS.items() if angle in names}
        self.names = [f"{name}_{person}" for name in (*names, *mapped)]
        self._indices = [index for index, _ in mapped.values()]
        self._signs = np.array([sign for _, sign in mapped.values()])

    def extend(self, values: np.ndarray) -> np.ndarray:
        """Return positions or velocities with those of the mapped joints."""
        return np.concatenate([values, values[self._indices] * self._signs])


@dataclass(frozen=True)
class Naming:
    """Names of one person's frames and joints.

    prefix: of frames and links. body_id: the person's id under REP-155, which allows no prefix; the names end with it.
    """

    prefix: str = ""
    body_id: str = ""

    @classmethod
    def of_person(cls, config: NodeSettings, node: str, person: str = "") -> Naming:
        """Return the naming of a person: by default tracker/pelvis, or tracker/p1/pelvis for the person p1.

        node: the node's full name without the first slash, `~` in frame_prefix; person: id, empty if one is followed.
        """
        if config.rep155 and person:
            return cls(body_id=person)
        return cls(config.frame_prefix.replace("~", node) + f"{person}/" * bool(person))

    def link(self, name: str) -> str:
        """Return the name of a TF frame or URDF link."""
        return f"{name}_{self.body_id}" if self.body_id else f"{self.prefix}{name}"

    def link_of_joint(self, joint: str) -> str:
        """Return the name of the frame of a joint of the skeleton. A frame of REP-155 may have the joint's name."""
        return self.link(f"{joint}_joint" if self.body_id and joint in LINKS else joint)

    def joint(self, name: str) -> str:
        """Return the name of a URDF joint."""
        return f"{name}_{self.body_id}" if self.body_id else name


BODY = "body"


class BodyFrames:
    """Names and transforms of the TF frames of one person."""

    def __init__(self, skeleton: Skeleton, config: NodeSettings, node: str, person: str = "") -> None:
        """node: full name without the first slash; person: id, empty for one person."""
        naming = Naming.of_person(config, node, person)
        body = naming.link(BODY)
        hips = [joint for joint, name in enumerate(skeleton.joint_names) if name in ("left_hip", "right_hip")]
        self._hips = hips if config.rep155 and len(hips) == 2 else []  # whose mean is the body's origin in REP-155
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
            if naming.body_id and (found := links_of(skeleton.joint_names)):  # at the joints, with axes of their own
                self.names += [(links[index], naming.link(link)) for link, index, _ in found]
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
