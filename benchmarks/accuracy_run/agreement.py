"""Agreement of results between versions of Python, numpy and scipy: track a fixed sequence and compare the joints.

    python benchmarks/accuracy_run/agreement.py --save here.npz              # in one environment
    python benchmarks/accuracy_run/agreement.py --compare here.npz there.npz # the largest difference of any joint, mm

It needs only the dependencies of the core.
"""

from __future__ import annotations

import argparse
import platform
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import numpy as np
import proxsuite
import scipy

from lassokin_ros.core.image.projection import project
from lassokin_ros.core.observation import Observation
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.demo.synthetic import motion

FRAMES, RATE, FOCAL, NOISE_PX = 600, 30.0, 1000.0, 2.0


def versions() -> str:
    """The versions that may differ between environments."""
    found = {"numpy": np.__version__, "scipy": scipy.__version__, "proxsuite": proxsuite.__version__}
    return f"Python {platform.python_version()}, " + ", ".join(f"{name} {version}" for name, version in found.items())


def joints() -> np.ndarray:
    """(FRAMES, n, 3) m: the synthetic motion with noise, gaps and wrong points, tracked; NaN where refused."""
    tracker = Tracker()
    random = np.random.RandomState(0)  # its sequence is the same in all versions; that of default_rng may change
    times = np.arange(FRAMES) / RATE
    points = project(tracker.kinematics.pose(motion(tracker.skeleton, times)).landmarks)
    points = points + random.normal(size=points.shape) * NOISE_PX / FOCAL
    wrong = random.uniform(size=points.shape[:2]) < 0.02
    points[wrong] += random.normal(size=(wrong.sum(), 2)) * 0.05
    confidence = np.where(random.uniform(size=points.shape[:2]) < 0.05, 0.0, 0.9)
    found = np.full((FRAMES, tracker.skeleton.joint_count, 3), np.nan)
    for i, stamp in enumerate(times):
        estimate = tracker.track(Observation(float(stamp), points[i], confidence[i], FOCAL))
        if estimate.pose is not None:
            found[i] = estimate.pose.positions
    return found


def save(file: Path) -> None:
    np.savez_compressed(file, joints=joints(), versions=versions())
    print(f"{file}: {versions()}")


def load(file: Path) -> tuple[str, np.ndarray]:
    """The versions and the joints of a file written by `save`."""
    with np.load(file, allow_pickle=False) as data:
        return str(data["versions"]), data["joints"]


def difference_mm(one: np.ndarray, other: np.ndarray) -> float:
    """The largest distance of a joint between two results, mm; infinite if only one of them has a frame."""
    if (np.isnan(one) != np.isnan(other)).any():
        return float("inf")
    return 1e3 * float(np.nanmax(np.linalg.norm(one - other, axis=-1)))


def compare(files: list[Path]) -> None:
    """A table of each file compared with the first."""
    (first, reference), *others = [load(file) for file in files]
    print(f"{FRAMES} frames; largest difference of a joint, mm, against {first}")
    for name, found in others:
        print(f"  {name:<60} {difference_mm(reference, found):.2e}")


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--save", type=Path, metavar="FILE")
    parser.add_argument("--compare", type=Path, nargs="+", metavar="FILE")
    options = parser.parse_args()
    if options.save:
        save(options.save)
    if options.compare:
        compare(options.compare)


if __name__ == "__main__":
    main()
