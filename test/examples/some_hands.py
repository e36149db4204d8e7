"""Hands of synthetic people in some postures, for tests without a detector."""

import numpy as np

from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.body.skeleton import Skeleton

FINGERS = ("index", "middle", "ring", "pinky")
STRAIGHT, BENT = (0.05, 0.1, 0.05), (1.45, 1.75, 1.0)
POSTURES = {
    "open_palm": ([STRAIGHT] * 4, (0.0, -0.1, 0.0)),
    "fist": ([BENT] * 4, (0.55, 0.6, 0.8)),
    "pointing": ([STRAIGHT, BENT, BENT, BENT], (0.55, 0.6, 0.8)),
    "thumbs_up": ([BENT] * 4, (-0.3, -0.1, -0.1)),
    "victory": ([STRAIGHT, STRAIGHT, BENT, BENT], (0.55, 0.6, 0.8)),
    "relaxed": ([(0.4, 0.55, 0.35)] * 4, (0.1, 0.2, 0.3)),
    "grasp": ([(0.65, 0.8, 0.5)] * 4, (0.4, 0.3, 0.4)),
    "three": ([STRAIGHT, STRAIGHT, STRAIGHT, BENT], (0.55, 0.6, 0.8)),
    "telephone": ([BENT, BENT, BENT, STRAIGHT], (-0.3, -0.1, -0.1)),
    "claw": ([(-0.1, 1.3, 0.8)] * 4, (0.0, 0.3, 0.8)),
    "flat": ([(0.95, 0.1, 0.05)] * 4, (0.2, 0.1, 0.2)),
    "ring": ([(0.8, 1.0, 0.6), STRAIGHT, STRAIGHT, STRAIGHT], (0.45, 0.35, 0.6)),
}
"""Bends of knuckle, middle and last joint of the four fingers, and of the thumb's three joints, rad."""
SPREAD = {"index": 0.12, "middle": 0.0, "ring": -0.1, "pinky": -0.2}
"""rad to the thumb's side in a victory or an open palm."""


def bends(name, random=None):
    """(4, 3) and (3,) rad of a posture, (4,) rad of the spread; varied by a generator."""
    fingers, thumb = (np.array(part, float) for part in POSTURES[name])
    spread = np.array([SPREAD[finger] for finger in FINGERS]) * (name in ("open_palm", "victory"))
    if random is not None:
        fingers, thumb = fingers + random.normal(size=(4, 3)) * 0.12, thumb + random.normal(size=3) * 0.08
        spread = spread + random.normal(size=4) * 0.04
    return fingers.clip(-0.3, 1.9), thumb, spread


class SomeHand:
    """A person's hand, with lengths that differ from the built-in ones."""

    def __init__(self, side="right", random=None):
        skeleton = Skeleton.load(f"{side}_hand", 1.75)
        if random is not None:
            skeleton = skeleton.with_bone_scales(np.exp(random.normal(size=16) * 0.05))
        self.body, self.sign = (
            Kinematics(skeleton, Layout.load(f"{side}_hand21", skeleton)),
            1 if side == "left" else -1,
        )
        self.side = side

    def points(self, fingers, thumb, spread):
        """(21, 3) m from the wrist, in the frame of the wrist."""
        vectors = np.zeros((16, 3))
        for row, finger in enumerate(FINGERS):
            for k in range(3):
                turn = np.array([0.0, -spread[row] if k == 0 else 0.0, -fingers[row, k]])
                vectors[self.body.skeleton.index(f"{self.side}_{finger}{k + 1}")] = turn * [1, self.sign, self.sign]
        turns = ((0.1, thumb[0], -0.4 * thumb[0]), (0.0, thumb[1], 0.0), (0.0, thumb[2], 0.0))
        for k, turn in enumerate(turns, 1):
            vectors[self.body.skeleton.index(f"{self.side}_thumb{k}")] = np.array(turn) * [1, self.sign, self.sign]
        return self.body.pose(BodyState(exponential(vectors), np.zeros(3))).landmarks


def posture(name, side="right"):
    """(21, 3) m of a posture."""
    return SomeHand(side).points(*bends(name))
