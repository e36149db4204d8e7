"""The body's surface as a depth camera sees it: capsules along the bones.

At a landmark's keypoint the camera measures the nearest surface. In a side view this often is another part of the body.
"""

from __future__ import annotations

import numpy as np

from lassokin_ros.core.body.kinematics import BodyPose
from lassokin_ros.core.body.roles import BONES
from lassokin_ros.core.body.skeleton import Skeleton

HEAD = (0.0, 0.055, 0.012), 0.055
"""Middle of the skull in the head's frame, and its radius, / height."""


def surface_depths(skeleton: Skeleton, pose: BodyPose, points: np.ndarray) -> np.ndarray:
    """(k,) m: depth at which the line of sight to points (k, 3) m first meets the body, infinite if it misses.

    Bones and joints that the skeleton does not have are left out.
    """
    names, scale = skeleton.joint_names, skeleton.height
    bones = [bone for bone in BONES if bone.radius and {bone.first, bone.last} <= set(names)]
    starts = pose.positions[np.array([names.index(bone.first) for bone in bones], dtype=int)]
    ends = pose.positions[np.array([names.index(bone.last) for bone in bones], dtype=int)]
    radii = np.array([bone.radius for bone in bones]) * scale
    if "head" in names:
        head = names.index("head")
        skull = pose.positions[head] + pose.orientations[head] @ (np.array(HEAD[0]) * scale)
        starts, ends = np.concatenate([starts, [skull]]), np.concatenate([ends, [skull]])
        radii = np.append(radii, HEAD[1] * scale)
    return np.asarray(_entry_depths(points / points[:, 2:], starts, ends, radii).min(axis=1, initial=np.inf))


def _entry_depths(rays: np.ndarray, starts: np.ndarray, ends: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """(k, c) m: depth at which rays (k, 3) with z = 1 enter capsules with ends (c, 3) and radii (c,), or infinity."""
    axes = ends - starts
    ray2, axis2 = (rays * rays).sum(-1)[:, None], (axes * axes).sum(-1)
    along, towards, start_along = rays @ axes.T, rays @ starts.T, (starts * axes).sum(-1)
    a = axis2 * ray2 - along**2
    b = axis2 * towards - start_along * along
    c = axis2 * ((starts * starts).sum(-1) - radii**2) - start_along**2
    with np.errstate(invalid="ignore", divide="ignore"):
        side = (b - np.sqrt(b * b - a * c)) / a
        place = side * along - start_along
        depth = np.where((place > 0) & (place < axis2), side, np.inf)
        for points in (starts, ends):
            middle = rays @ points.T
            ball = middle - np.sqrt(middle**2 - ray2 * ((points * points).sum(-1) - radii**2))
            depth = np.fmin(depth, ball / ray2)
    return np.asarray(depth)
