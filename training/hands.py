"""Synthetic hands: people's bones and axes, postures between gestures, and views of them. Nobody's data is used.

A posture has 14 numbers, rad: flexion of the four knuckles (index, middle, ring, pinky), of the four middle joints, the
spread of the fingers, the rotation vector of the thumb's base, and the flexion of its two outer joints. The last joint
of a finger bends by a share of the middle one (Rijpkema and Girard, Computer animation of knowledge-based human
grasping, SIGGRAPH 1991: 2/3). All hands are left hands, in the axes of the skeleton left_hand, with the wrist at 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lassokin_ros.core.body.kinematics import Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.network.hand_network import POINTS, hand_index

FINGERS = ("index", "middle", "ring", "pinky")
OPEN, BENT, CLOSED = (0.0, 0.1), (0.6, 0.8), (1.4, 1.75)
"""Flexion of a finger's knuckle and middle joint."""


def _gesture(fingers: str, spread: float, *thumb: float) -> np.ndarray:
    """fingers: for each one o(pen), b(ent) or c(losed)."""
    flexions = np.array([{"o": OPEN, "b": BENT, "c": CLOSED}[one] for one in fingers])
    return np.concatenate([flexions[:, 0], flexions[:, 1], [spread], thumb])


GESTURES = {
    "open palm": _gesture("oooo", 0.12, 0.0, -0.1, 0.0, 0.0, 0.0),
    "relaxed": np.array([0.35, 0.45, 0.5, 0.5, 0.5, 0.6, 0.6, 0.6, 0.03, 0.0, 0.1, 0.0, 0.2, 0.3]),
    "fist": _gesture("cccc", -0.02, 0.1, 0.7, -0.35, 0.6, 0.9),
    "pointing": _gesture("occc", 0.0, 0.1, 0.6, -0.3, 0.6, 0.8),
    "victory": _gesture("oocc", 0.2, 0.1, 0.65, -0.35, 0.6, 0.8),
    "three": _gesture("oooc", 0.12, 0.1, 0.6, -0.3, 0.6, 0.8),
    "thumb up": _gesture("cccc", -0.02, -0.2, -0.3, 0.1, -0.1, -0.2),
    "call": _gesture("ccco", 0.1, -0.1, -0.25, 0.1, -0.1, -0.1),
    "grasp": _gesture("bbbb", 0.04, 0.1, 0.4, -0.3, 0.3, 0.4),
    "pinch": np.array([0.75, 0.3, 0.3, 0.3, 0.85, 0.4, 0.4, 0.4, 0.02, 0.1, 0.45, -0.25, 0.3, 0.5]),
    "ok": np.array([0.8, 0.15, 0.1, 0.05, 1.0, 0.2, 0.15, 0.1, 0.1, 0.1, 0.5, -0.3, 0.35, 0.6]),
    "claw": np.array([-0.1, -0.1, -0.1, -0.1, 1.3, 1.3, 1.3, 1.3, 0.1, 0.0, 0.1, 0.0, 0.3, 0.8]),
    "flat": np.array([0.9, 0.95, 1.0, 1.0, 0.1, 0.1, 0.1, 0.1, 0.0, 0.05, 0.2, -0.1, 0.1, 0.2]),
}
"""Postures between which hands move."""
LOW = np.array([-0.4] * 4 + [0.0] * 4 + [-0.3] + [-1.0] * 3 + [-0.3] * 2)
HIGH = np.array([1.6] * 4 + [1.9] * 4 + [0.4] + [1.0] * 3 + [1.2] * 2)
VARIATION = np.array([0.15] * 8 + [0.06] + [0.15] * 5)
"""rad: standard deviation about the gestures."""
SPREADING = np.array([1.2, 0.15, -0.8, -1.6])
"""Share of each finger in the spread."""
SIZE, BONE, PALM, AXIS, DIP = 0.06, 0.05, 0.03, 0.10, (0.62, 0.06)
"""Standard deviations between people: logarithms of the size, a bone and the palm, the direction of an axis; and mean
and deviation of the share by which the last joint bends."""


TILT = 0.45
"""rad: standard deviation about the directions."""


def _axes(fingers: tuple[float, ...], back: tuple[float, ...]) -> np.ndarray:
    """(3, 3) orientation of a left hand whose fingers (+x) and back (+y) point to these directions in the camera."""
    x = np.array(fingers) / np.linalg.norm(fingers)
    y = np.array(back) - x * (x @ np.array(back))
    y /= np.linalg.norm(y)
    return np.stack([x, y, np.cross(x, y)], axis=1)


DIRECTIONS = np.array([
    _axes((0, -1, 0), (0, 0, 1)), _axes((0, -1, 0), (0, 0, -1)), _axes((0, -1, 0), (1, 0, 0)),
    _axes((0, -1, 0), (-1, 0, 0)), _axes((0, -0.3, -1), (0, -1, 0)), _axes((1, 0, -0.3), (0, -1, 0)),
    _axes((-1, 0, -0.3), (0, -1, 0)), _axes((0, 1, 0), (0, 0, -1)),
])  # fmt: skip
"""Up with palm, back and edges to the camera; to the camera; to the sides; down."""
SHARES = np.array([0.28, 0.12, 0.12, 0.12, 0.14, 0.08, 0.08, 0.06])
"""How often people hold a hand like this before a camera."""


def orientations(random: np.random.Generator, count: int) -> np.ndarray:
    """(n, 3, 3) in the camera: half of them anywhere, half about the `DIRECTIONS`."""
    anywhere = random.normal(size=(count, 4))
    anywhere /= np.linalg.norm(anywhere, axis=1, keepdims=True)
    half = np.arccos(np.clip(anywhere[:, :1], -1, 1))  # a uniform quaternion
    turned = exponential(2 * half * anywhere[:, 1:] / np.maximum(np.sin(half), 1e-9))
    chosen = DIRECTIONS[random.choice(len(DIRECTIONS), size=count, p=SHARES)]
    usual = chosen @ exponential(TILT * random.normal(size=(count, 3)))
    return np.where((random.random(count) < 0.5)[:, None, None], usual, turned)


@dataclass(frozen=True, eq=False)
class Hand:
    """offsets: (21, 3) m, of each of `POINTS` from its parent, the wrist's 0; axes: (21, 3) unit vectors of flexion."""

    offsets: np.ndarray
    axes: np.ndarray
    dip: float


def _rest() -> np.ndarray:
    """(21, 3) m, offsets of `POINTS` from their parents, of a person of 1.75 m."""
    skeleton = Skeleton.load("left_hand", 1.75)
    layout = Layout.load("left_hand21", skeleton)
    index = hand_index(Kinematics(skeleton, layout), "left")
    assert index is not None
    tip = np.array([point.endswith("_tip") for point in POINTS])
    return np.where(tip[:, None], layout.offsets[index], skeleton.offsets[layout.joints[index]])


REST = _rest()
PARENT = np.array([-1, *(0 if point.endswith("1") else index for index, point in enumerate(POINTS[1:]))])


def somebody(random: np.random.Generator) -> Hand:
    """The hand of another person. Its axes are not those of the skeleton."""
    scale = np.exp(random.normal() * SIZE)
    sizes = np.exp(random.normal(size=(21, 1)) * np.where(PARENT == 0, PALM, BONE)[:, None])
    offsets = REST * scale * sizes
    offsets[PARENT == 0] += random.normal(size=(5, 3)) * [0.002, 0.0015, 0.002]
    axes = np.tile([0.0, 0.0, -1.0], (21, 1))
    for index, point in enumerate(POINTS):
        if point.startswith("thumb"):
            axes[index] = [0.2, 0.95, -0.1]
        elif point != "wrist":  # bent fingers converge
            axes[index, 0] = (0.10, 0.0, -0.10, -0.20)[FINGERS.index(point[:-1] if point[-1] in "123" else point[:-4])]
    axes += random.normal(size=axes.shape) * AXIS
    return Hand(offsets, axes / np.linalg.norm(axes, axis=1, keepdims=True), DIP[0] + random.normal() * DIP[1])


def points_of(hand: Hand, postures: np.ndarray) -> np.ndarray:
    """(n, 21, 3) m: `POINTS` of a hand in postures (n, 14)."""
    turns = np.tile(np.eye(3), (len(postures), 21, 1, 1))
    for number, finger in enumerate(FINGERS):
        first = POINTS.index(f"{finger}1")
        knuckle, middle = postures[:, number], postures[:, 4 + number]
        spread = postures[:, 8] * SPREADING[number] * np.cos(np.clip(knuckle, 0, 1.5))
        aside = exponential(np.outer(-spread, [0.0, 1.0, 0.0]))
        turns[:, first] = exponential(np.outer(knuckle, hand.axes[first])) @ aside
        turns[:, first + 1] = exponential(np.outer(middle, hand.axes[first + 1]))
        turns[:, first + 2] = exponential(np.outer(hand.dip * middle, hand.axes[first + 2]))
    thumb = POINTS.index("thumb1")
    turns[:, thumb] = exponential(postures[:, 9:12])
    for outer in (1, 2):
        turns[:, thumb + outer] = exponential(np.outer(postures[:, 11 + outer], hand.axes[thumb + outer]))
    places, world = np.zeros((len(postures), 21, 3)), turns.copy()
    for point in range(1, 21):
        above = PARENT[point]
        places[:, point] = places[:, above] + world[:, above] @ hand.offsets[point]
        world[:, point] = world[:, above] @ turns[:, point]
    return places


def postures(random: np.random.Generator, count: int) -> np.ndarray:
    """(n, 14): between two gestures, a quarter of the fingers as in a third one."""
    table = np.array(list(GESTURES.values()))
    one, other, third = table[random.integers(len(table), size=(3, count))]
    found = one + (other - one) * random.beta(0.5, 0.5, size=(count, 1)) + random.normal(size=(count, 14)) * VARIATION
    mixed = random.random((count, 4)) < 0.25
    found[:, :8] = np.where(np.concatenate([mixed, mixed], axis=1), third[:, :8], found[:, :8])
    return np.clip(found, LOW, HIGH)
