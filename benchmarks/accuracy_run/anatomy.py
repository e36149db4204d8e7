"""Figures that say in which way a skeleton is wrong: joint angles, lean of the trunk, sliding feet, exchanged sides.

Positions are (f, j, 3) m in the frame of a camera that does not move, NaN = unknown. Names are `l_hip`, `r_knee`, ...
"""

from __future__ import annotations

from typing import Sequence

import numpy as np

SIDES = ("l", "r")
BENDS = {"knee": ("hip", "knee", "ankle"), "elbow": ("shoulder", "elbow", "wrist")}
LEG, ARM = BENDS.values()
WINDOW_S = 0.25
"""s over which a foot's slide is measured."""
STILL = 0.1
"""m/s: a foot whose place changes by less over `WINDOW_S` stands still."""
EXCHANGED = 0.05
"""m by which both legs, or both arms, are nearer to the other side's in a frame with exchanged sides."""
FIGURES = (
    "knee_bias_deg knee_error_deg elbow_bias_deg elbow_error_deg trunk_bias_deg trunk_error_deg slide_mm_s skate_mm_s "
    "exchanged_percent"
).split()
COLUMNS = {figure: ".0f" if figure.endswith("mm_s") else ".1f" for figure in FIGURES}


def body_figures(estimate: np.ndarray, truth: np.ndarray, names: Sequence[str], stamps: np.ndarray) -> dict[str, float]:
    """All `FIGURES` of a track; NaN where nothing is known. stamps: (f,) s.

    bias: mean of estimate - truth; error: mean of its absolute value. Knees and elbows: positive = bent further. Trunk:
    positive = leans further forward, and the error is the angle between the two directions. slide: mm/s, change of an
    ankle's place over `WINDOW_S` while the true one stands still. skate: mm/s, its speed from frame to frame meanwhile.
    """
    result = {}
    for name, joints in BENDS.items():
        differences = np.concatenate([
            flexion(estimate, names, side, joints) - flexion(truth, names, side, joints) for side in SIDES
        ])  # fmt: skip
        result[f"{name}_bias_deg"] = _mean(differences)
        result[f"{name}_error_deg"] = _mean(np.abs(differences))
    bias, error = trunk_differences(estimate, truth, names)
    result |= {"trunk_bias_deg": _mean(bias), "trunk_error_deg": _mean(error)}
    ankles = [list(names).index(f"{side}_ankle") for side in SIDES]
    slide, skate = foot_speeds(estimate[:, ankles], still_feet(truth[:, ankles], stamps), stamps)
    result |= {"slide_mm_s": 1000 * _mean(slide), "skate_mm_s": 1000 * _mean(skate)}
    exchanged, known = exchanged_frames(estimate, truth, names)
    result["exchanged_percent"] = 100 * float(np.mean(exchanged[known])) if known.any() else float("nan")
    return result


def flexion(points: np.ndarray, names: Sequence[str], side: str, joints: Sequence[str]) -> np.ndarray:
    """(f,) degrees by which the middle one of three joints is bent; 0 = straight."""
    a, b, c = (points[:, list(names).index(f"{side}_{joint}")] for joint in joints)
    return np.degrees(_angle(b - a, c - b))


def trunk_axes(points: np.ndarray, names: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """(f, 3) from the middle of the hips to that of the shoulders, and from the right hip to the left one, m."""
    left, right, *shoulders = (list(names).index(n) for n in ("l_hip", "r_hip", "l_shoulder", "r_shoulder"))
    return points[:, shoulders].mean(1) - points[:, [left, right]].mean(1), points[:, left] - points[:, right]


def trunk_differences(estimate: np.ndarray, truth: np.ndarray, names: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """(f,) degrees: further lean to the front about the true hip axis, and the angle between the trunks."""
    (own, _), (true, left) = trunk_axes(estimate, names), trunk_axes(truth, names)
    forward = np.cross(left, true)
    forward /= np.linalg.norm(forward, axis=-1, keepdims=True)
    up = true / np.linalg.norm(true, axis=-1, keepdims=True)
    lean = np.arctan2(np.sum(own * forward, axis=-1), np.sum(own * up, axis=-1))
    return np.degrees(lean), np.degrees(_angle(own, true))


def still_feet(places: np.ndarray, stamps: np.ndarray) -> np.ndarray:
    """(f, k) bool: from this frame on, each of k points (f, k, 3) m moves more slowly than `STILL` for `WINDOW_S`."""
    end = _window_ends(stamps)
    elapsed = np.append(stamps, np.inf)[end] - stamps
    moved = np.linalg.norm(_at(places, end) - places, axis=-1)
    return np.asarray(moved < STILL * np.where(np.isfinite(elapsed), elapsed, 0.0)[:, None])


def foot_speeds(places: np.ndarray, still: np.ndarray, stamps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """m/s of points (f, k, 3) where `still` (f, k): over `WINDOW_S`, and from each frame of these windows to the next.

    The results are flat, NaN where a place is unknown.
    """
    end = _window_ends(stamps)
    elapsed = np.append(stamps, np.nan)[end] - stamps
    over = np.linalg.norm(_at(places, end) - places, axis=-1) / elapsed[:, None]
    step = np.linalg.norm(np.diff(places, axis=0), axis=-1) / np.diff(stamps)[:, None]
    within = np.zeros((len(step), still.shape[1]), dtype=bool)
    for frame, foot in np.argwhere(still):
        within[frame : end[frame], foot] = True
    return over[still], step[within]


def exchanged_frames(estimate: np.ndarray, truth: np.ndarray, names: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """(f,) bool: legs or arms are those of the other side, by `EXCHANGED` on average; and whether that is known."""
    exchanged, known = np.zeros(len(truth), dtype=bool), np.zeros(len(truth), dtype=bool)
    for limb in (LEG, ARM):
        one, other = (
            [list(names).index(f"{side}_{joint}") for side in sides for joint in limb] for sides in ("lr", "rl")
        )
        centre = truth[:, one].mean(1, keepdims=True) - estimate[:, one].mean(1, keepdims=True)
        right = np.linalg.norm(estimate[:, one] + centre - truth[:, one], axis=-1).mean(-1)
        wrong = np.linalg.norm(estimate[:, one] + centre - truth[:, other], axis=-1).mean(-1)
        exchanged |= right - wrong > EXCHANGED
        known |= np.isfinite(right)
    return exchanged, known


def _window_ends(stamps: np.ndarray) -> np.ndarray:
    """(f,) the first frame at least `WINDOW_S` after each frame; f if there is none."""
    return np.searchsorted(stamps, stamps + WINDOW_S - 1e-6)


def _at(places: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """places[frames], NaN beyond the end."""
    return np.concatenate([places, np.full((1, *places.shape[1:]), np.nan)])[frames]


def _angle(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(...,) rad between two vectors (..., 3)."""
    return np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), np.sum(a * b, axis=-1))


def _mean(values: np.ndarray) -> float:
    return float(np.nanmean(values)) if np.isfinite(values).any() else float("nan")
