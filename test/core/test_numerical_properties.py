"""Numerical properties that hold for any duration and any library version."""

import subprocess
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from benchmarks.numerics import agreement, drift  # noqa: E402


def test_rotations_stay_rotations_over_two_million_retractions():
    """24 joints of 10 bodies, 8400 successive steps; benchmarks/numerics/drift.py computes 10 million of one body."""
    gram, det = drift.retracted(10, 8400)
    assert gram < 1e-14 and det < 1e-14


def test_drift_without_correction_is_detected():
    gram, _ = drift.retracted(2, 8400, mended=False)
    assert gram > 1e-14


def test_the_sequence_for_comparing_versions_is_deterministic(tmp_path):
    """Computed in another process and here: the same bytes, a difference of 0."""
    file = tmp_path / "there.npz"
    script = ROOT / "benchmarks" / "numerics" / "agreement.py"
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
