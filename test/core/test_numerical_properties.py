"""Numerical properties that hold for any duration and any library version."""

import subprocess
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from benchmarks.accuracy_run import agreement  # noqa: E402
from lassokin_ros.core.body.kinematics import BodyState  # noqa: E402
from lassokin_ros.core.body.rotations import exponential, orthonormalised  # noqa: E402


def retracted(bodies, mended):
    """Largest |R^T R - I| and |det R - 1| of 24 rotations of each body after 8400 successive steps of the tracker."""
    random, still = np.random.default_rng(0), np.zeros((bodies, 3))
    rotations = exponential(random.normal(size=(bodies, 24, 3)))
    for _ in range(8400):
        state = BodyState(rotations, still).retract(0.05 * random.normal(size=(bodies, 72)), still)
        rotations = orthonormalised(state.rotations) if mended else state.rotations
    gram = np.swapaxes(rotations, -1, -2) @ rotations
    return np.abs(gram - np.eye(3)).max(), np.abs(np.linalg.det(rotations) - 1).max()


def test_rotations_stay_rotations_over_two_million_retractions():
    assert max(retracted(10, mended=True)) < 1e-14


def test_drift_without_correction_is_detected():
    assert retracted(2, mended=False)[0] > 1e-14


def test_the_sequence_for_comparing_versions_is_deterministic(tmp_path):
    """Computed in another process and here: the same bytes, a difference of 0."""
    file = tmp_path / "there.npz"
    script = ROOT / "benchmarks" / "accuracy_run" / "agreement.py"
    subprocess.run([sys.executable, script, "--save", file], check=True, capture_output=True)
    here = agreement.joints()
    versions, there = agreement.load(file)
    assert versions == agreement.versions() and np.isfinite(here).all()
    assert here.tobytes() == there.tobytes() and agreement.difference_mm(here, there) == 0


def test_a_difference_is_detected():
    one = np.zeros((3, 24, 3))
    other = one.copy()
    other[1, 5, 2] = 2e-3
    assert np.isclose(agreement.difference_mm(one, other), 2.0)
    other[2] = np.nan
    assert agreement.difference_mm(one, other) == np.inf
