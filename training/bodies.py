"""Bodies for the depth network's training: people's proportions, and landmarks at the places that detectors mark.

A captured body's joints are other points than those that detectors mark: CMU's hips are closer together and its
forearms shorter. The tracker's built-in body has the lengths that detectors see. In a share of the samples the lengths
are therefore drawn from those of recorded people about the built-in body (priors/people_lengths.yaml), otherwise about
the captured ones. In all samples the landmarks lie elsewhere on each body, by a constant in the body.
"""

from __future__ import annotations

import numpy as np

from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.learned.bone_lengths import POPULATIONS, population
from lassokin_ros.core.network.depth_network import LENGTHS, NAMES, lengths_of
from training.motion import HEIGHT_PARTS, Motion
from training.symmetry import OTHER

PEOPLE = 0.65
"""Share of the samples with people's lengths."""
CHILDREN = 0.12
"""Share of the samples with a child's proportions."""
FORWARD_EARS = 0.5
"""Share of the samples with ears as MediaPipe marks them: 5 cm further in front, 1 cm higher, 1 cm further inwards."""

SEGMENTS = "hips", "thigh", "shank", "foot", "trunk", "shoulders", "upper arm", "forearm", "neck", "head"
"""Lengths that are scaled, the same on both sides."""
_SPREADS = np.array([0.08, 0.05, 0.05, 0.08, 0.06, 0.07, 0.06, 0.06, 0.08, 0.08])
"""Standard deviations of the log-lengths about captured ones."""
_GROWTH = np.array([0, -0.12, -0.12, 0, 0.05, -0.05, -0.08, -0.08, 0.0, 0.45])
"""What is added to the factors for a small child."""
_NAMES_OF_PRIOR = {"hips": "hip width", "shoulders": "shoulder width"}
_OF_HEIGHT = [SEGMENTS.index(part) for part in HEIGHT_PARTS]
_OF_LENGTHS = [SEGMENTS.index(length) for length in LENGTHS]

_INDEX = {name: point for point, name in enumerate(NAMES)}
_HIPS, _SHOULDERS = ([_INDEX[f"{side}_{joint}"] for side in ("left", "right")] for joint in ("hip", "shoulder"))
_CHAINS = [
    ("knee", "hip", "thigh"),
    ("ankle", "knee", "shank"),
    ("heel", "ankle", "foot"),
    ("toe", "ankle", "foot"),
    ("elbow", "shoulder", "upper arm"),
    ("wrist", "elbow", "forearm"),
]
PLACES = {"hip": 1.5, "shoulder": 1.5, "head_top": 1.5, "heel": 1.2, "toe": 1.2, "ankle": 1.1, "knee": 0.9}
"""How far landmarks lie from the joints, relative to others; as measured on recorded people."""
_PLACES = np.array([next((s for part, s in PLACES.items() if n.endswith(part)), 0.75) for n in NAMES], dtype=np.float32)
LEAST_OFF, MOST_OFF = 0.003, 0.010
"""In heights: range of a body's deviation of the landmarks' places, which `PLACES` multiplies."""


class Bodies:
    """Draws the bodies that carry out a motion."""

    def __init__(self, motion: Motion) -> None:
        self._motion = motion
        built_in = lengths_of(Skeleton.load("anthropometric", 1.0))
        #: (clips, SEGMENTS): log-factors from the captured to the built-in lengths.
        self._to_built_in = np.zeros((len(motion.lengths), len(SEGMENTS)))
        self._to_built_in[:, _OF_LENGTHS] = np.log(built_in * motion.parts.sum(1)[:, None] / motion.lengths)
        names, _, covariance = population(POPULATIONS[0])
        chosen = [names.index(_NAMES_OF_PRIOR.get(name, name)) for name in SEGMENTS]
        self._people = np.linalg.cholesky(covariance[np.ix_(chosen, chosen)])

    def drawn(self, clip: np.ndarray, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Factors (b, SEGMENTS) on the segments of clips (b,), and the resulting heights (b,) and lengths in them."""
        size, motion = len(clip), self._motion
        normal = random.standard_normal((size, len(SEGMENTS)))
        people = (random.random(size) < PEOPLE)[:, None]
        own = np.exp(np.where(people, normal @ self._people.T, normal * _SPREADS))
        child, grown = random.random(size) < CHILDREN, random.random(size)[:, None]
        own[child] *= 1 + grown[child] * _GROWTH
        height = (motion.parts[clip] * own[:, _OF_HEIGHT]).sum(1)
        factors = own * np.exp(np.where(people, self._to_built_in[clip], 0.0))
        return factors, height, motion.lengths[clip] * factors[:, _OF_LENGTHS] / height[:, None]


def reshaped(points: np.ndarray, factors: np.ndarray) -> np.ndarray:
    """(b, slots, canonical, 3) m: the same poses of bodies with lengths multiplied by factors (b, SEGMENTS)."""
    scale = dict(zip(SEGMENTS, factors.T.astype(np.float32)[..., None, None, None]))
    new = np.empty_like(points)
    middle, girdle = points[:, :, _HIPS].mean(2, keepdims=True), points[:, :, _SHOULDERS].mean(2, keepdims=True)
    chest = middle + (girdle - middle) * scale["trunk"]

    def move(name: str, base: np.ndarray, origin: np.ndarray, segment: str) -> None:
        p = _INDEX[name]
        new[:, :, p : p + 1] = base + (points[:, :, p : p + 1] - origin) * scale[segment]

    for side in ("left", "right"):
        move(f"{side}_hip", middle, middle, "hips")
        move(f"{side}_shoulder", chest, girdle, "shoulders")
        for joint, parent, segment in _CHAINS:
            p = _INDEX[f"{side}_{parent}"]
            move(f"{side}_{joint}", new[:, :, p : p + 1], points[:, :, p : p + 1], segment)
    move("mid_hip", middle, middle, "hips")
    move("neck", chest, girdle, "neck")
    move("head", chest, girdle, "neck")
    head = _INDEX["head"]
    for name in ("nose", "left_ear", "right_ear", "head_top"):
        move(name, new[:, :, head : head + 1], points[:, :, head : head + 1], "head")
    return new


def landmarks(points: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """(b, slots, canonical, 3): where a detector sees the points of bodies, in heights."""
    size, count = len(points), points.shape[2]
    deviation = np.exp(random.uniform(np.log(LEAST_OFF), np.log(MOST_OFF), size)).astype(np.float32)
    own = random.standard_normal((size, count, 3), dtype=np.float32) * (_PLACES * deviation[:, None])[..., None]
    own = 0.8 * own + 0.6 * own[:, OTHER] * np.array([-1, 1, 1], dtype=np.float32)
    lower = random.standard_normal((size, 1, 3), dtype=np.float32) * np.array([0, 0.012, 0.006], dtype=np.float32)
    own[:, _HIPS] += lower
    result: np.ndarray = points + own[:, None] @ trunk_axes(points)
    _move_ears_forward(result, points, np.flatnonzero(random.random(size) < FORWARD_EARS))
    return result


def _move_ears_forward(result: np.ndarray, points: np.ndarray, rows: np.ndarray) -> None:
    """Move the ears of some bodies in place, along the axes of the head that its points define.

    See `CANONICAL` for these: in heights, the nose is 0.072 in front of the head's joint and 0.032 above it, the head's
    top 0.112 above it, and the ears are 0.082 apart.
    """
    chosen = points[rows]
    head, nose, top, left, right = (
        chosen[:, :, _INDEX[name]] for name in ("head", "nose", "head_top", "left_ear", "right_ear")
    )
    up = (top - head) / 0.112
    front = (nose - head - 0.032 * up) / 0.072
    inwards = 0.0065 * (left - right) / 0.082
    result[rows, :, _INDEX["left_ear"]] += 0.029 * front + 0.0065 * up - inwards
    result[rows, :, _INDEX["right_ear"]] += 0.029 * front + 0.0065 * up + inwards


def trunk_axes(points: np.ndarray) -> np.ndarray:
    """(b, slots, 3, 3): rows x to the person's left, y up along the trunk, z to the front."""
    x = points[:, :, _HIPS[0]] - points[:, :, _HIPS[1]]
    y = points[:, :, _SHOULDERS].mean(2) - points[:, :, _HIPS].mean(2)
    y = y / (np.linalg.norm(y, axis=-1, keepdims=True) + 1e-6)
    x = x - (x * y).sum(-1, keepdims=True) * y
    x = x / (np.linalg.norm(x, axis=-1, keepdims=True) + 1e-6)
    return np.stack([x, y, np.cross(x, y)], axis=-2)
