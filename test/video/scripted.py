"""Detectors of known output, for the command `track`."""

import numpy as np

from lassokin_ros.detector.backend import Detected

STANDING = np.array(
    [[0, -80], [4, -84], [-4, -84], [9, -82], [-9, -82], [20, -60], [-20, -60], [26, -30], [-26, -30], [28, 0],
     [-28, 0], [11, 0], [-11, 0], [12, 45], [-12, 45], [12, 88], [-12, 88]], float
)  # fmt: skip
"""px: COCO's keypoints of a person of 170 px, from the middle."""


def person(x, scale=1.0, noise=0.0):
    return Detected(STANDING * scale + (x, 120) + noise, np.full(17, 0.9))


def standing(seconds):
    return [person(160)]


def walking(seconds):
    """A person who sways; nobody is found in the images from 1 s to 2.5 s."""
    if 1.0 <= seconds < 2.5:
        return []
    noise = np.random.default_rng(round(1000 * seconds)).normal(size=(17, 2))
    return [person(160 + 10 * np.sin(3 * seconds), noise=noise)]


def two(seconds):
    """A small person on the left walks; a large one on the right leaves at 2.5 s. The order changes at random."""
    random = np.random.default_rng(round(1000 * seconds))
    places = [(60 + 10 * seconds, 0.5)] + [(230 + 5 * np.sin(3 * seconds), 1.0)] * (seconds < 2.5)
    people = [person(*place, random.normal(scale=0.5, size=(17, 2))) for place in places]
    return [people[i] for i in random.permutation(len(people))]


class Scripted:
    """Finds what a function returns for the time of an image, s."""

    landmarks = "coco17"

    def __init__(self, found=standing, several=False):
        self.found, self.several, self.times = found, several, []

    def detect(self, image, seconds):
        self.times.append(seconds)
        return self.found(seconds)

    def close(self):
        pass
