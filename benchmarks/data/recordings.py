"""Who is in the recordings of the shared data, and which files a folder of them has to score."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

PEOPLE = {
    "balancing": "man who balances",
    "openpose_balancing": "man who balances",
    "talking_woman": "woman who talks",
    "opencap_squat": "woman A",
    "opencap_walk_ts": "woman D",
    "opencap2": "man E",
    "caliscope": "man at a desk",
    "mediapipe_upper_body": "man of pyxy3d",
    "pyxy3d": "man of pyxy3d",
    "shelf_person0": "shelf, person 0",
    "shelf_person3": "shelf, person 3",
    "wildflower_person0": "wildflower, person 0",
    "wildflower_person2": "wildflower, person 2",
}
"""Person by the beginning of a file's name."""
APART = ("man of pyxy3d", "wildflower, ")
"""People who are apart in the summary: an upper body near the camera, and a reference that is good to about 50 mm."""


def recorded_person(name: str) -> str:
    """The person of a recording; its name if the person is not listed in `PEOPLE`."""
    return next((person for start, person in PEOPLE.items() if name.startswith(start)), name)


def recording_group(name: str) -> str:
    """The recordings that count as one in the summary: the same person and motion, seen by one family of detectors."""
    return name.removesuffix("_full").removesuffix("_heavy")


def counts_apart(person: str) -> bool:
    """Whether a person is one of `APART`."""
    return person.startswith(APART)


def recording_files(given: Iterable[Path]) -> list[Path]:
    """The files, and of each folder its recordings with a reference. Raises SystemExit if a folder has none."""
    files = []
    for path in given:
        inside = [file for file in sorted(path.glob("*.npz")) if _has_reference(file)] if path.is_dir() else [path]
        if not inside:
            raise SystemExit(f"no recording with a reference (ref_cam) in {path}; expected npz files of detections")
        files += inside
    return files


def _has_reference(file: Path) -> bool:
    with np.load(file) as data:
        return "ref_cam" in data and "kp2d" in data
