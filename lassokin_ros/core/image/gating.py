"""Gating: whether an observation can be used, the weight of each landmark, and which depths can belong to the body.

A depth camera measures the nearest surface at a landmark's keypoint. In a side view this often is another part of the
body, whose surface is that of capsules along the bones.
"""

from __future__ import annotations

import math

import numpy as np

from lassokin_ros.core.body.kinematics import BodyPose
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.roles import BONES
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.observation import Observation, Rejection

FOCAL_RANGE = 1e-3, 1e9
"""px: a focal length outside this range is rejected, because the weights would lose digits."""
LATEST_STAMP = 1e11
"""s: no time is later, in the year 5138; one in ms, us or ns since 1970 is."""
WIDEST = 10.0
"""Largest normalised image coordinate of a usable point: 84 degrees off the optical axis."""


def gate_observation(
    observation: Observation, newest: float, layout: Layout, config: TrackerConfig
) -> tuple[Rejection | None, np.ndarray]:
    """The reason to reject an observation (or None), and the weights (l,): 1 / standard deviation, 0 = not used.

    newest: s, the observation's stamp must be later. Weights are in normalised image coordinates.
    """
    count = len(layout.names)
    none = np.zeros(count)
    if not _has_numbers(observation):
        return Rejection.NOT_FINITE, none
    if _is_empty(observation):
        return Rejection.TOO_FEW_LANDMARKS, none
    if not _fits(observation, count):
        return Rejection.WRONG_SHAPE, none
    if observation.stamp <= newest:
        return Rejection.OLD_STAMP, none
    usable = visible(observation, config)
    if np.count_nonzero(usable) < config.min_landmarks:
        return Rejection.TOO_FEW_LANDMARKS, none
    deviation = config.noise_px / observation.focal * layout.noise
    confidence = np.minimum(np.where(usable, observation.confidence, 0.0), 1.0)
    return None, np.sqrt(confidence) / deviation


def _has_numbers(observation: Observation) -> bool:
    """True if the stamp is a time in s and the focal length usable."""
    try:
        is_time = -LATEST_STAMP < observation.stamp < LATEST_STAMP
        return bool(is_time and FOCAL_RANGE[0] < observation.focal < FOCAL_RANGE[1])
    except (TypeError, ValueError):  # None, a text, two numbers
        return False


def _is_empty(observation: Observation) -> bool:
    """True if there is no point: detectors return arrays without values if nobody is in view."""
    arrays = observation.points, observation.confidence
    return all(isinstance(a, np.ndarray) and a.size == 0 for a in arrays)


def _fits(observation: Observation, count: int) -> bool:
    """True if all arrays of an observation are of real numbers and have one row per landmark; count: of these."""
    o, one_each = observation, (count,)
    arrays = [(o.points, (count, 2)), (o.confidence, one_each)]
    arrays += [(array, one_each) for array in (o.depth, o.depth_deviation) if array is not None]
    return all(isinstance(a, np.ndarray) and a.shape == shape and a.dtype.kind in "fiub" for a, shape in arrays)


def visible(observation: Observation, config: TrackerConfig) -> np.ndarray:
    """(l,) bool: landmarks with a usable point and enough confidence."""
    near = np.abs(observation.points) < WIDEST
    return near[:, 0] & near[:, 1] & (observation.confidence >= max(config.min_confidence, 1e-9))


DEPTH_RANGE = 0.05, 100.0
"""m: a depth outside this range is ignored."""
HIDDEN = 0.03
"""Distance / height behind the body's nearest surface from which on a landmark's own surface is hidden."""
THINNEST = 0.5
"""The distance from the surface to the landmark may be less than `surface` by at most this share of it."""
SAME_SURFACE = 0.12
"""m: a depth this near to the body's nearest surface is that of this surface."""


def of_own_surface(
    depth: np.ndarray, landmarks: np.ndarray, nearest: np.ndarray, surface: np.ndarray, height: float
) -> np.ndarray:
    """Depths (l,) m of a camera, corrected by the last pose, so that `surface` is the distance to the landmarks.

    A landmark behind another part of the body was not measured: NaN. For the others the distance from the surface to
    the landmark along the line of sight, which is longer inside a limb that leans, is that of the last pose, within
    limits. A depth in front of the nearest surface, or behind it, is kept: there the last pose is wrong.

    landmarks: (l,) m, depths of the last pose's landmarks. nearest: (l,) m, where the line of sight meets the last
    pose's body. surface: m, as in `gate_depth`; height: m, of the person.
    """
    more = landmarks - nearest - surface
    with np.errstate(invalid="ignore"):
        met = np.abs(depth - nearest) < SAME_SURFACE
    corrected = depth + np.clip(more, -THINNEST * surface, HIDDEN * height)
    return np.where(met, np.where(more > HIDDEN * height, np.nan, corrected), depth)


def gate_depth(
    observation: Observation,
    visible: np.ndarray,
    surface: np.ndarray | float,
    expected: float | None,
    reach: float,
    noise: float,
) -> tuple[np.ndarray, np.ndarray] | None:
    """(depth, weights) of an observation, each (l,), or None if no depth can be used.

    visible: (l,) bool, landmarks whose keypoints are used. surface: (l,) m from the body's surface to the landmark.
    expected: m, depth of the person; None for the median of the measurements. reach: m, measurements farther from the
    person are ignored. noise: m, standard deviation unless the observation gives it. weights: 1/m, 0 = not used.
    """
    if observation.depth is None or not math.isfinite(observation.depth_age):
        return None
    depth = np.asarray(observation.depth, dtype=float)
    if observation.depth_of_surface:
        depth = depth + surface
    given = observation.depth_deviation
    deviation = np.full(depth.shape, noise) if given is None else np.asarray(given, dtype=float)
    with np.errstate(invalid="ignore"):
        used = visible & (depth > DEPTH_RANGE[0]) & (depth < DEPTH_RANGE[1]) & (deviation > 0) & (deviation < 10.0)
    if not used.any():
        return None
    centre = float(np.median(depth[used])) if expected is None else expected
    used &= np.abs(np.where(used, depth, centre) - centre) < reach
    if not used.any():
        return None
    deviation = np.maximum(np.where(used, deviation, 1.0), 0.005)  # a surface is not known more exactly
    weights = np.where(used, 1 / deviation, 0.0)
    return np.where(used, depth, 0.0), weights


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
