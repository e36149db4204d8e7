"""Findings about videos: nobody is there, people who lie, and words that agree with each other."""

from collections import Counter
from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import pytest

from lassokin_ros.replay.report import findings
from lassokin_ros.replay.report.facts import landmark_errors

LANDMARKS = ("left_shoulder", "right_shoulder", "left_hip", "right_hip", "left_ankle", "right_ankle")


@dataclass
class Facts:
    """What the rules read."""

    tracks: list = field(default_factory=list)
    messages: tuple = ()
    landmarks: tuple = LANDMARKS
    own_keypoints: bool = True
    rate: float = 30.0
    level: np.ndarray = field(default_factory=lambda: np.eye(3))
    people: tuple = ("",)
    cameras: tuple = ("",)

    def __post_init__(self):
        self.log = SimpleNamespace(messages=self.messages)
        self.node = SimpleNamespace(several_people=False)
        joints = (*(f"{side}_{joint}" for side in ("left", "right") for joint in ("hip", "knee", "ankle")), "pelvis")
        self.skeleton = SimpleNamespace(joint_names=joints)
        self.times = np.arange(len(self.messages)) / self.rate
        self.duration = len(self.messages) / self.rate

    def rows(self, person):
        return self.tracks

    accepted = rows


def keys(rule, facts):
    return Counter(raised.key for raised in rule(facts))


@pytest.mark.parametrize("shown, doubted", [("0010011000", 1), ("0000111111", 0), ("0001100000", 0), ("1111111111", 0)])
def test_scraps_of_skeletons_are_probably_nobody(shown, doubted):
    messages = tuple(SimpleNamespace(people=int(one)) for one in "".join(one * 4 for one in shown))
    assert keys(findings._probably_nobody, Facts(messages=messages))["probably_nobody"] == doubted


def lying(points):
    return Facts([SimpleNamespace(detected=np.array(points, dtype=float))] * 3)


def test_a_bridge_is_not_upside_down_but_hanging_is():
    bridge = lying([[100, 300], [100, 300], [200, 220], [200, 220], [300, 290], [300, 290]])
    steep = lying([[100, 330], [100, 330], [200, 260], [200, 260], [300, 240], [300, 240]])
    hanging = lying([[100, 400], [130, 400], [100, 300], [130, 300], [100, 200], [130, 200]])
    assert [keys(findings._upside_down, one)["upside_down"] for one in (bridge, steep, hanging)] == [0, 0, 1]


def test_the_fit_is_judged_by_the_size_of_the_body_also_of_people_who_lie():
    flat = np.array([[0.0, 0.0], [400.0, 60.0]])
    for error, doubted in ((5.0, 0), (15.0, 1)):
        facts = Facts([SimpleNamespace(outline=flat, reprojection_px=error)] * 3)
        assert keys(findings._poor_fit, facts)["poor_fit"] == doubted


def test_knees_are_not_judged_by_a_few_frames_with_legs():
    for seen, doubted in ((20, 0), (70, 1)):
        rows = [
            SimpleNamespace(observed=np.full(7, frame < seen), bends=np.full(7, 40.0), positions=None)
            for frame in range(100)
        ]
        assert keys(findings.bent_knees, Facts(rows))["bent_knees"] == doubted


def test_a_landmark_that_is_placed_but_hardly_seen_does_not_count_as_seen():
    row = SimpleNamespace(
        in_view=lambda name, number: np.zeros((6, 2)) + (name == "detected"), visible=np.arange(6) != 4
    )
    middle, seen = landmark_errors(Facts(), [row] * 4)
    assert np.allclose(middle, np.sqrt(2)) and seen.tolist() == [1, 1, 1, 1, 0, 1]
