"""Keypoints of several people, for any duration: the synthetic motion, seen by a detector with errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.data.depth_images import SIZE, render
from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.demo.synthetic import WEBCAM, Detector, detections, exact_pixels, motion

HEIGHT, LANDMARKS = 1.75, "coco17"
APART_M, BACK_M, LATER_S = 0.8, 0.25, 3.1
"""m between neighbouring people; m by which each person more moves all away from the camera; delay of the motion from
one person to the next, s."""


@dataclass(frozen=True, eq=False)
class View:
    """f frames of p people: pixels (f, p, 17, 2) and confidences (f, p, 17), 0 where nothing was found."""

    pixels: np.ndarray
    confidence: np.ndarray


def view(first: int, count: int, hz: float, people: int, detector: Detector = Detector()) -> View:
    """Frames `first` to `first + count` of an endless motion. The same call gives the same numbers."""
    skeleton = Skeleton.load("anthropometric", HEIGHT)
    kinematics = Kinematics(skeleton, Layout.load(LANDMARKS, skeleton))
    pixels, confidence = [], []
    for person in range(people):
        state = motion(skeleton, (first + np.arange(count)) / hz + LATER_S * person)
        place = np.array([(person - (people - 1) / 2) * APART_M, 0.0, BACK_M * people])
        exact = exact_pixels(kinematics, BodyState(state.rotations, state.translation + place))
        found = detections(exact, hz, seed=1000 * first + person, detector=detector)
        pixels.append(found[0])
        confidence.append(found[1])
    return View(np.stack(pixels, axis=1), np.stack(confidence, axis=1))


def depth_images(count: int, hz: float) -> list[np.ndarray]:
    """(480, 848) mm, uint16, one for each of the first frames of one person: the body before a wall.

    The lens' distortion is left out; it is about a pixel at the body.
    """
    skeleton = Skeleton.load("anthropometric", HEIGHT)
    kinematics = Kinematics(skeleton, Layout.load(LANDMARKS, skeleton))
    state = motion(skeleton, np.arange(count) / hz)
    pose = kinematics.pose(BodyState(state.rotations, state.translation + np.array([0.0, 0.0, BACK_M])))
    names = [name.replace("left", "l").replace("right", "r").replace("foot", "toe") for name in skeleton.joint_names]
    K, (width, height) = WEBCAM.K, WEBCAM.size
    off_centre = np.array([(K[0, 2] - width / 2) / K[0, 0], (K[1, 2] - height / 2) / K[1, 1]])
    images = []
    for positions, orientations in zip(pose.positions, pose.orientations):
        top = positions[skeleton.index("head")] + orientations[skeleton.index("head")] @ [0.0, 0.11 * HEIGHT, 0.0]
        joints = dict(zip((*names, "head_top"), (*positions, top)))
        shifted = {name: place + [*(place[2] * off_centre), 0.0] for name, place in joints.items()}
        images.append((1000 * render(shifted, HEIGHT, K[0, 0] * SIZE[0] / width)).astype("<u2"))
    return images
