"""A user's own evidence: its rows by name, its data, and faults, after which it is left out."""

from dataclasses import replace

import numpy as np
import pytest
from cases import body
from sequences import CONFIG, observations, same

from lassokin_ros.core.errors import ConfigurationError
from lassokin_ros.core.evidence.evidence import Evidence
from lassokin_ros.core.evidence.frame_model import FrameModel
from lassokin_ros.core.evidence.pose_prior import PoseDistribution
from lassokin_ros.core.tracker import Tracker

FRAMES = 12


class Range(Evidence):
    """The distance of the root along the optical axis, m, with a deviation of 1 cm, as `extra["range"]`."""

    name, count = "range", 1

    def present(self, frame):
        return "range" in frame.extra

    def linearise(self, about, columns, z):
        columns[...] = 0.0
        columns[..., -1, :] = 100.0
        z[..., 0] = 100.0 * self.error(about.states, about.frame)

    def cost(self, states, frame):
        return 0.5 * (100.0 * self.error(states, frame)) ** 2

    @staticmethod
    def error(states, frame):
        return frame.extra["range"] - states.state.translation[..., 2]


def with_method(**methods):
    """The evidence with other methods or attributes, in a new class."""
    return type("Faulty", (Range,), methods)()


def raises(*arguments):
    raise RuntimeError("no calibration")


def not_filled(self, about, columns, z):
    z[...] = 0.0


def not_finite(self, about, columns, z):
    Range.linearise(self, about, columns, z)
    z[...] = np.nan


def too_large(self, about, columns, z):
    """A deviation of 1 micrometre: the lasso's answers would not be certified."""
    Range.linearise(self, about, columns, z)
    columns *= 1e4
    z *= 1e4


def other_shape(self, about, columns, z):
    columns[...] = np.zeros((7, 5))


FAULTS = {
    "present raises": {"present": raises},
    "linearise raises": {"linearise": raises},
    "not filled": {"linearise": not_filled},
    "not finite": {"linearise": not_finite},
    "too large": {"linearise": too_large},
    "other shape": {"linearise": other_shape},
    "cost raises": {"cost": raises},
    "cost of another shape": {"cost": lambda *given: np.zeros(5)},
    "cost is not finite": {"cost": lambda *given: np.array(np.nan)},
}


def tracked(evidence, extra=None):
    """(tracker, estimates) of some frames with the true distance of the root, or with other extra data."""
    tracker = Tracker(CONFIG, evidence=evidence)
    estimates = []
    for truth, observation in observations(tracker, FRAMES / 30):
        given = {"range": truth[0, 2]} if extra is None else extra
        estimates.append(tracker.track(replace(observation, extra=given)))
    return tracker, estimates


def test_the_slices_of_all_pieces_cover_all_rows_once():
    tracker, estimates = tracked([Range()])
    for estimate in estimates:
        taken = np.concatenate([np.arange(own.start, own.stop) for own in estimate.increment.rows.values()])
        assert np.array_equal(np.sort(taken), np.arange(len(estimate.increment.problem.z)))
    built_in = ["image", "pose prior", "upright", "balance", "learned depth", "foot contact"]
    assert list(estimates[-1].increment.rows) == [*built_in, "range"]
    assert {name: own.stop - own.start for name, own in estimates[-1].increment.rows.items()} == {
        name: tracker.frame_model.pieces[name].count for name in estimates[-1].increment.rows
    }
    with_depth = replace(observations(tracker, 1 / 30, start=1.0)[0][1], depth=np.full(17, 3.5))
    assert set(tracker.track(with_depth).increment.rows) == {*estimates[-1].increment.rows, "measured depth"} - {
        "range",
        "foot contact",
    }


def test_extra_data_reach_the_evidence():
    tracker, estimates = tracked([Range()])
    truth = [place[0, 2] for place, _ in observations(tracker, FRAMES / 30)]
    alone = tracked([])[1]
    errors, without = ([abs(e.solved.translation[2] - z) for e, z in zip(found, truth)] for found in (estimates, alone))
    assert max(errors) < 0.02 < max(without) and not tracker.frame_model.faults
    rows = estimates[-1].increment.rows["range"]
    assert np.array_equal(estimates[-1].increment.problem.B[rows], [[0.0, 0.0, 100.0]])


def test_evidence_without_its_data_has_no_rows():
    tracker, estimates = tracked([Range()], extra={})
    assert not tracker.frame_model.faults and all("range" not in estimate.increment.rows for estimate in estimates)
    assert all(same(a.solved, b.solved) for a, b in zip(estimates, tracked([])[1]))


@pytest.mark.parametrize("fault", FAULTS)
def test_faulty_evidence_is_named_and_left_out(fault):
    """From the first call on, so that the answers are those of a tracker without it."""
    tracker, estimates = tracked([with_method(**FAULTS[fault])])
    said = tracker.frame_model.faults
    assert list(said) == ["range"] and said["range"].startswith("evidence 'range' is left out: ")
    assert all(estimate.accepted for estimate in estimates) and "range" not in estimates[-1].increment.rows
    # Rows whose cost is at fault are right, and place the first frame's body, until the cost is asked for.
    tolerance = 0.05 if "cost" in fault else 1e-9
    for one, other in zip(estimates, tracked([])[1]):
        assert np.allclose(one.solved.translation, other.solved.translation, rtol=0, atol=tolerance)
        assert "cost" in fault or np.allclose(one.solved.rotations, other.solved.rotations, rtol=0, atol=tolerance)


def test_a_fault_during_tracking_leaves_the_evidence_out_from_then_on():
    calls = []

    def sometimes(self, about, columns, z):
        calls.append(1)
        Range.linearise(self, about, columns, z)
        if len(calls) == 100:
            raise ZeroDivisionError("the sensor is gone")

    tracker = Tracker(CONFIG, evidence=[with_method(linearise=sometimes)])
    rows = []
    for truth, observation in observations(tracker, 4.0):
        estimate = tracker.track(replace(observation, extra={"range": truth[0, 2]}))
        assert estimate.accepted and estimate.certificate.kkt_residual < 1e-6
        rows.append("range" in estimate.increment.rows)
    assert rows[0] and not rows[-1] and rows == sorted(rows, reverse=True) and len(calls) == 100
    assert "ZeroDivisionError: the sensor is gone" in tracker.frame_model.faults["range"]


def test_faulty_length_rows_are_left_out_of_the_calibration():
    tracker = Tracker(CONFIG, evidence=[with_method(length_rows=lambda *given: np.full((1, 2), 1.0))])
    for truth, observation in observations(tracker, 2.0):
        assert tracker.track(replace(observation, extra={"range": truth[0, 2]})).accepted
    assert "range" in tracker.frame_model.faults and np.isfinite(tracker.learned.lengths.deviation).all()


@pytest.mark.parametrize(
    "wrong, said",
    [
        ([with_method(name=None)], "has name None"),
        ([with_method(name="")], "has name ''"),
        ([with_method(count=0)], "has count 0"),
        ([with_method(count=2.0)], "has count 2.0"),
        ([Range(), Range()], "two pieces of evidence are named 'range'"),
        ([with_method(name="image")], "two pieces of evidence are named 'image'"),
        ([with_method(name="image 2")], "evidence is named 'image 2', as that of a further camera"),
    ],
)
def test_a_wrong_name_or_number_of_rows_raises(wrong, said):
    kinematics = body()
    with pytest.raises(ConfigurationError, match=said):
        FrameModel(kinematics, PoseDistribution.load(kinematics.skeleton), wrong)
