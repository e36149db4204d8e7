"""Names, frames and joints of REP-155, as far as this skeleton has them; docs/rep155.md lists the rest.

Frames and joints of a body end with `_<id>`. REP-155 names fifteen frames below `body_<id>`; their axes are those of
the package human_description: x to the front and z up for a person who stands with hanging arms.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lassokin_ros.pipeline.frame_result import BODY_FROM_ROOT

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


def suffix(person: str) -> str:
    """Return the suffix of a person's frames and joints."""
    return f"_{person}"


def links_of(joints: Sequence[str]) -> list[tuple[str, int, np.ndarray]]:
    """Return REP-155's links of a skeleton with these joints: name, index of the joint, axes (3, 3)."""
    names = list(joints)
    return [(link, names.index(joint), axes) for link, (joint, axes) in LINKS.items() if joint in names]


class MappedJoints:
    """The joint states of a body under REP-155: those of the URDF, then the mapped ones."""

    def __init__(self, names: Sequence[str], person: str) -> None:
        """names: of the joints, without a suffix."""
        mapped = {name: (names.index(angle), sign) for name, (angle, sign) in JOINTS.items() if angle in names}
        self.names = [f"{name}{suffix(person)}" for name in (*names, *mapped)]
        self._indices = [index for index, _ in mapped.values()]
        self._signs = np.array([sign for _, sign in mapped.values()])

    def extend(self, values: np.ndarray) -> np.ndarray:
        """Return positions or velocities with those of the mapped joints."""
        return np.concatenate([values, values[self._indices] * self._signs])
