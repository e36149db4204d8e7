"""Trackers of several people in one batch: the answers of each are those of a single run."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from sequences import CONFIG, observations

from lassokin_ros.core import batch as together
from lassokin_ros.core.batch import BatchedCall, batched, run_batched, run_single
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.errors import ConfigurationError
from lassokin_ros.core.evidence.frame_model import FrameModel
from lassokin_ros.core.hypotheses.body_hypotheses import BodyHypotheses
from lassokin_ros.core.hypotheses.limb_hypotheses import LimbHypotheses
from lassokin_ros.core.tracker import Tracker


def people(count=4):
    """Trackers and observations: different motion, noise and lengths, one person who comes later, one with gaps."""
    trackers, sights = [], []
    for person in range(count):
        random = np.random.default_rng(person)
        skeleton = Skeleton.load("anthropometric", 1.75)
        scales = 1 + 0.05 * random.normal(size=skeleton.joint_count)
        trackers.append(Tracker(CONFIG, skeleton.with_bone_scales(scales if person % 2 else np.ones(len(scales)))))
        seen = [observation for _, observation in observations(trackers[-1], 3.0, start=0.7 * person, seed=person)]
        stamps = [frame / 30 for frame in range(len(seen))]
        sights.append([replace(observation, stamp=stamp) for observation, stamp in zip(seen, stamps)])
    sights[1][:10] = [without_points(observation) for observation in sights[1][:10]]
    sights[2][20:70] = [without_points(observation) for observation in sights[2][20:70]]
    sights[3][50:55] = [replace(o, points=sights[3][49].points, stamp=o.stamp) for o in sights[3][50:55]]
    return trackers, list(zip(*sights))


def without_points(observation):
    return replace(observation, points=np.full_like(observation.points, np.nan))


KEPT = {
    "_body_hypotheses": ("_states", "_age", "_advantage", "_costs", "image_costs", "_increments", "_linearised"),
    "_limbs": ("_rotations", "_age", "_advantage", "_apart"),
    "_upright": ("vertical",),
}


def arrays(value):
    """All arrays in the state of a tracker."""
    if value is None or isinstance(value, np.ndarray):
        return [] if value is None else [value]
    return [array for part in vars(value).values() for array in arrays(part)]


def kept(tracker):
    """The arrays from which the next frame starts, by name."""
    for part, names in KEPT.items():
        for name in names:
            if hasattr(getattr(tracker, part), name):
                for array in arrays(getattr(getattr(tracker, part), name)):
                    yield name, array


def test_each_person_gets_the_result_and_state_of_a_single_run():
    trackers, frames = people()
    others, _ = people()
    accepted, exchanged = 0, 0
    ages = set()
    for frame in frames:
        before = [tracker.state for tracker in others]
        answers = Tracker.track_batch(trackers, frame)
        expected = [tracker.track(seen) for tracker, seen in zip(others, frame)]
        ages.add(len({tracker._body_hypotheses._age[0] for tracker in others if tracker.state is not None}))
        for mine, theirs in zip(trackers, others):
            for (name, a), (_, b) in zip(kept(mine), kept(theirs), strict=True):
                assert a.shape == b.shape and np.allclose(a, b, rtol=1e-5, atol=1e-5), name
        exchanged += sum(o._successor is not None and b is not None for o, b in zip(others, before))
        for answer, one in zip(answers, expected):
            assert (answer.rejection, answer.status, answer.initialised) == (one.rejection, one.status, one.initialised)
            assert answer.repeated == one.repeated
            if one.accepted:
                accepted += 1
                assert np.allclose(answer.pose.positions, one.pose.positions, rtol=0, atol=1e-8)
                assert answer.cost == pytest.approx(one.cost, rel=1e-5)
                assert answer.certificate.kkt_residual < 1e-6
    assert accepted > 250 and exchanged > 0
    assert all(np.allclose(a.skeleton.offsets, b.skeleton.offsets) for a, b in zip(trackers, others))
    assert not np.allclose(trackers[1].skeleton.offsets, trackers[0].skeleton.offsets)
    assert max(ages) > 2 and np.ptp([tracker._upright.vertical for tracker in others], axis=0).max() > 0.01


def test_equal_work_is_computed_in_one_batch(monkeypatch):
    trackers, frames = people()
    calls = []
    for kind, name in ((FrameModel, "other_cost"), (LimbHypotheses, "_posed")):
        original = getattr(kind, name)
        monkeypatch.setattr(
            kind, name, lambda *a, original=original, name=name, **k: calls.append(name) or original(*a, **k)
        )
    for frame in frames[:19]:
        calls.clear()
        answers = Tracker.track_batch(trackers, frame)
    assert all(answer.accepted and not answer.initialised for answer in answers)
    assert sorted(calls) == ["_posed", "other_cost"]


def test_calls_with_different_optional_arrays_are_not_batched():
    """Batches of different people, or in another order, do not change the results."""
    trackers, frames = people()
    others, _ = people()
    for number, frame in enumerate(frames[:40]):
        answers = Tracker.track_batch(trackers, frame)
        order = np.random.default_rng(number).permutation(len(frame))
        mixed = Tracker.track_batch([others[i] for i in order], [frame[i] for i in order])
        for place, person in enumerate(order):
            a, b = answers[person], mixed[place]
            assert a.rejection == b.rejection
            assert not a.accepted or np.allclose(a.pose.positions, b.pose.positions, rtol=0, atol=1e-9)


@pytest.mark.parametrize("method", ["linearise", "advance", "compute_costs"])
def test_an_error_for_one_person_does_not_affect_the_others(monkeypatch, method):
    trackers, frames = people()
    others, _ = people()
    original = getattr(BodyHypotheses, method)

    def failing(self, *arguments):
        if self._states.state.translation.ndim > 2 or self is trackers[0]._body_hypotheses:
            raise RuntimeError("on purpose")
        return original(self, *arguments)

    failing.reads, failing.writes = original.reads, original.writes
    for number, frame in enumerate(frames[:45]):
        with monkeypatch.context() as patch:
            if number == 30:
                patch.setattr(BodyHypotheses, method, failing)
                with pytest.raises(RuntimeError, match="on purpose"):
                    Tracker.track_batch(trackers, frame)
            else:
                Tracker.track_batch(trackers, frame)
        for tracker, seen in list(zip(others, frame))[1:]:
            expected = tracker.track(seen)
    assert np.allclose(trackers[3].state.rotations, others[3].state.rotations, rtol=0, atol=1e-8)
    assert expected.accepted and Tracker.track_batch(trackers, frames[45])[0].accepted


def test_an_empty_batch_gives_no_results():
    assert Tracker.track_batch([], []) == []


def test_incompatible_trackers_of_a_batch_raise():
    trackers, frames = people(4)
    with pytest.raises(ValueError, match="argument 2 is shorter"):
        Tracker.track_batch(trackers, frames[0][:2])
    unlike = Tracker(replace(CONFIG, landmarks="h36m17"))
    with pytest.raises(ConfigurationError, match="the same layout"):
        Tracker.track_batch([trackers[0], unlike], frames[0][:2])


@dataclass(eq=False)
class Pair:
    """Two arrays."""

    a: np.ndarray
    b: np.ndarray


class Part:
    """Records how often it was called, and for how many people at once."""

    asked: list = []

    def __init__(self, value):
        self.value, self.seen = np.array([value]), None

    @staticmethod
    def stack(several):
        return Part(0.0)

    @batched(reads=("value",), writes=("seen",))
    def double(self, pair):
        Part.asked.append(self.value.shape[:-1])
        self.seen = pair.a + self.value
        return Pair(2 * self.value, pair.b)


def steps(part, times):
    total = 0.0
    for _ in range(times):
        answer = yield BatchedCall(part, "double", (Pair(np.array([1.0]), np.array([part.value[0] + 1])),))
        total += answer.a[0] + answer.b[0]
    return total


def test_calls_of_one_kind_are_batched_and_each_person_gets_the_own_result():
    parts = [Part(value) for value in (1.0, 2.0, 3.0)]
    Part.asked = []
    assert run_batched([steps(part, times) for part, times in zip(parts, (2, 0, 1))]) == [8.0, 0.0, 10.0]
    assert Part.asked == [(2,), ()]
    assert [None if part.seen is None else part.seen[0] for part in parts] == [2.0, None, 4.0]
    assert run_single(steps(parts[1], 3)) == 21.0


def test_arrays_are_stacked_and_taken_apart_by_people():
    pairs = [Pair(np.full((2, 3), float(i)), np.array(i)) for i in range(3)]
    whole = together.stack_values(pairs)
    assert whole.a.shape == (3, 2, 3) and whole.b.tolist() == [0, 1, 2]
    assert np.array_equal(together.select_person(whole, 2).a, pairs[2].a) and together.select_person(None, 1) is None
