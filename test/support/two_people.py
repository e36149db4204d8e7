"""Scenes of two people who cross, leave and return: what a detector sends, and where both are. Each has a seed."""

from dataclasses import dataclass

import numpy as np
from messages import FOCAL, HEIGHT, WIDTH

from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.image.projection import project
from lassokin_ros.demo.synthetic import motion

RATE, SECONDS = 15.0, 9.0
"""Hz and s of a scene."""
HIDDEN_SHARE = 0.35
"""The one behind is not detected while their centres are nearer than this share of the nearer one's height."""
KINDS = ("cross", "followed leaves", "bystander leaves", "both leave", "cross twice")
SKELETON = Skeleton.load("anthropometric", 1.75)
KINEMATICS = Kinematics(SKELETON, Layout.load("coco17", SKELETON))


@dataclass
class Scene:
    """pixels: (2, f, 17, 2), NaN = outside the image; places: (2, f, 3) m, of the pelvis; seen: (2, f) bool.

    The first person is the one to follow.
    """

    pixels: np.ndarray
    places: np.ndarray
    seen: np.ndarray


def scene(seed):
    """The scene of a seed; the kind is KINDS[seed % 5]."""
    random = np.random.default_rng(seed)
    t = np.arange(int(RATE * SECONDS)) / RATE
    depths = random.permutation([random.uniform(2.6, 3.4), random.uniform(3.8, 5.0)])
    side = random.choice([-1.0, 1.0])
    away = side * (0.5 * WIDTH / FOCAL * depths + 0.8)  # out of view
    start = side * np.array([-0.5, 0.5]) * random.uniform(0.8, 1.2, 2)
    kind = KINDS[seed % len(KINDS)]
    points = {  # times in s and x in m of each person
        "cross": [([0, 1, 5, 9], [start[0], start[0], -start[0], -start[0]])] * 2,
        "followed leaves": [([0, 1.5, 3, 5, 7], [start[0], start[0], -away[0], -away[0], start[0]])] * 2,
        "bystander leaves": [([0, 9], [start[0], start[0] / 2])] * 2,
        "both leave": [([0, 1.5, 3, 5, 6.5], [start[0], start[0], -away[0], -away[0], start[0]])] * 2,
        "cross twice": [([0, 1, 4, 5, 8], [start[0], start[0], -start[0], -start[0], start[0]])] * 2,
    }[kind]
    others = {
        "cross": ([0, 1, 5, 9], [start[1], start[1], -start[1], -start[1]]),
        "followed leaves": ([0, 9], [start[1], start[1] - 0.3 * side]),
        "bystander leaves": ([0, 1.5, 3.5, 5, 7], [start[1], start[1], -away[1], -away[1], start[1]]),
        "both leave": ([0, 1, 3, 4, 5.5], [start[1], start[1], -away[1], -away[1], start[1]]),
        "cross twice": ([0, 1, 4, 5, 8], [start[1], start[1], -start[1], -start[1], start[1]]),
    }[kind]
    ways = [points[0], others]
    pixels, places = zip(*(_walk(t, *way, depth, random) for way, depth in zip(ways, depths)))
    pixels, places = np.array(pixels), np.array(places)
    inside = (pixels >= 0).all(axis=-1) & (pixels[..., 0] < WIDTH) & (pixels[..., 1] < HEIGHT)
    pixels[~inside] = np.nan
    seen = inside.sum(axis=-1) >= 5
    behind = int(np.argmax(depths))
    apart = np.abs(places[0, :, 0] / places[0, :, 2] - places[1, :, 0] / places[1, :, 2])
    seen[behind] &= apart > HIDDEN_SHARE * 1.75 / depths.min() * random.uniform(0.5, 1.0)
    seen &= random.random(seen.shape) > 0.02  # missed detections
    seen[:, 0] = True
    return Scene(pixels, places, seen)


def _walk(t, times, x, depth, random):
    """Keypoints with noise (f, 17, 2) px and the pelvis (f, 3) m of a person who walks along x."""
    state = motion(SKELETON, t + random.uniform(0, 3))
    places = state.translation.copy()
    places[:, 0] = np.interp(t, times, x) + random.normal(0, 0.02)
    places[:, 2] = depth + 0.2 * np.sin(t / 2 + random.uniform(0, 6))
    pose = KINEMATICS.pose(BodyState(state.rotations, places))
    noise = 2.0 * random.normal(size=(len(t), 17, 2))
    return project(pose.landmarks) * FOCAL + [WIDTH / 2, HEIGHT / 2] + noise, pose.positions[:, 0]


def numbers_of(seen, random):
    """(2, f) numbers of a detector's tracker: a person who was missed for more than 0.3 s gets a new number."""
    numbers, newest, away = np.zeros(seen.shape, int), 2, [0, 0]
    numbers[:, 0] = (0, 1)
    for i in range(1, seen.shape[1]):
        for who in (0, 1):
            numbers[who, i] = numbers[who, i - 1]
            away[who] = 0 if seen[who, i] else away[who] + 1
            if away[who] == int(0.3 * RATE):
                numbers[who, i], newest = newest, newest + int(random.integers(1, 3))
    return numbers
