"""Rules of the page: nobody is there, people who lie, an unlikely distance; and spans of a wrong pose."""

from collections import Counter
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lassokin_ros.doubt.doubt import Doubt
from lassokin_ros.replay.report import findings
from lassokin_ros.replay.report.facts import landmark_errors
from lassokin_ros.replay.spans import marked, wrong_spans

LANDMARKS = ("left_shoulder", "right_shoulder", "left_hip", "right_hip", "left_ankle", "right_ankle")


class Facts:
    """What the rules read. columns: of the table, all of whose frames have a skeleton."""

    landmarks, own_keypoints, rate, level, people, sizes = LANDMARKS, True, 30.0, np.eye(3), ("",), (None,)
    node = SimpleNamespace(several_people=False)

    def __init__(self, messages=(), **columns):
        self.columns = columns
        self.table = SimpleNamespace(messages=messages)
        joints = (*(f"{side}_{joint}" for side in ("left", "right") for joint in ("hip", "knee", "ankle")), "pelvis")
        self.skeleton = SimpleNamespace(joint_names=joints)
        self.times = np.arange(len(messages)) / self.rate
        self.duration = len(messages) / self.rate

    def rows(self, name, person=None):
        return self.columns[name]

    of = rows


def keys(rule, facts):
    return Counter(raised.key for raised in rule(facts))


@pytest.mark.parametrize("shown, doubted", [("0010011000", 1), ("0000111111", 0), ("0001100000", 0), ("1111111111", 0)])
def test_scraps_of_skeletons_are_probably_nobody(shown, doubted):
    messages = tuple(SimpleNamespace(people=int(one)) for one in "".join(one * 4 for one in shown))
    assert keys(findings._probably_nobody, Facts(messages=messages))["probably_nobody"] == doubted


def lying(points):
    return Facts(detected=np.array([points] * 3, dtype=float))


def test_a_bridge_is_not_upside_down_but_hanging_is():
    bridge = lying([[100, 300], [100, 300], [200, 220], [200, 220], [300, 290], [300, 290]])
    steep = lying([[100, 330], [100, 330], [200, 260], [200, 260], [300, 240], [300, 240]])
    hanging = lying([[100, 400], [130, 400], [100, 300], [130, 300], [100, 200], [130, 200]])
    assert [keys(findings._upside_down, one)["upside_down"] for one in (bridge, steep, hanging)] == [0, 0, 1]


def test_the_fit_is_judged_by_the_size_of_the_body_also_of_people_who_lie():
    flat = np.array([[[0.0, 0.0], [400.0, 60.0]]] * 3)
    for error, doubted in ((5.0, 0), (15.0, 1)):
        facts = Facts(outline=flat, reprojection_px=np.full(3, error))
        assert keys(findings._poor_fit, facts)["poor_fit"] == doubted


def test_knees_are_not_judged_by_a_few_frames_with_legs():
    turns = np.tile(Rotation.from_rotvec([40, 0, 0], degrees=True).as_matrix(), (100, 7, 1, 1))
    for seen, doubted in ((20, 0), (70, 1)):
        shown = np.tile(np.arange(100)[:, None] < seen, (1, 7))
        facts = Facts(joint_observed=shown, joint_positions=np.zeros((100, 7, 3)), joint_rotations=turns)
        assert keys(findings.bent_knees, facts)["bent_knees"] == doubted


def test_a_landmark_that_is_placed_but_hardly_seen_does_not_count_as_seen():
    places, visible = np.zeros((4, 6, 2)), np.tile(np.arange(6) != 4, (4, 1))
    facts = Facts(time=np.arange(4), detected=places + 1, reprojected=places, visible=visible)
    middle, seen = landmark_errors(facts)
    assert np.allclose(middle, np.sqrt(2)) and seen.tolist() == [1, 1, 1, 1, 0, 1]


@pytest.mark.parametrize("cameras, word", [([""], "`--camera-info`"), (["left", "right"], "translations are m")])
def test_an_unlikely_distance_names_what_gives_the_scale(cameras, word):
    facts = SimpleNamespace(skeletons=1, median=lambda name: 0.2, sizes=cameras, own_keypoints=True)
    (finding,) = findings.distance(facts)
    assert "is 0.2 m: check" in finding.text and word in finding.text


@pytest.mark.parametrize("factor, named", [(1.1, 0), (1.4, 1), (0.6, 1)])
def test_a_bone_that_changed_by_more_than_people_differ_is_named(factor, named):
    facts, offsets = Facts(), np.array([[0.0, 0.0, 0.0], [0.0, -0.4, 0.0]])
    facts.skeleton = SimpleNamespace(joint_names=("pelvis", "left_knee"), offsets=offsets)
    last = SimpleNamespace(skeleton=SimpleNamespace(offsets=factor * offsets))
    facts.table = SimpleNamespace(of=lambda person: SimpleNamespace(last=last))
    assert keys(findings.bones, facts)["bones"] == named


def test_many_times_are_not_all_listed():
    (raised,) = findings._initialised_again(Facts(time=np.arange(9.0), initialised=np.ones(9, dtype=bool)))
    assert "8 times, at 1.0, 2.0, 3.0, 4.0, 5.0, 6.0 s and 2 more times" in raised.text


def doubts(count, signs, figures=()):
    return [Doubt(reversed=i in signs, probability=0.9 if i in figures else 0.0) for i in range(count)]


def test_spans_lie_around_signs_and_at_figures_and_are_joined():
    times = np.arange(40) / 10
    spans = wrong_spans(times, doubts(40, (0, 10, 14, 30), (20, 21)))
    ends = [(0.0, 0.25), (0.75, 1.65), (2.0, 2.1), (2.75, 3.25)]
    assert np.allclose([(span.start, span.end) for span in spans], ends)
    assert [span.certain_sign for span in spans] == [True, True, False, True]
    assert np.flatnonzero(marked(times, spans)).tolist() == [0, 1, 2, *range(8, 17), 20, 21, *range(28, 33)]
    assert wrong_spans(times, doubts(40, ())) == wrong_spans(times[:0], []) == [] and not marked(times, []).any()
