"""Errors of a sequence of skeletons.

Positions are (f, j, 3) in m, in the camera frame (x right, y down, z forward); results are in mm unless another unit is
given.
"""

from __future__ import annotations

from typing import Any, Sequence

import numpy as np

from benchmarks.accuracy_run.anatomy import body_figures

LIMBS = tuple(
    (f"{s}_{a}", f"{s}_{b}")
    for s in ("l", "r")
    for a, b in (("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"), ("elbow", "wrist"))
)
"""(proximal, distal) joints of the eight limb bones whose depth sign counts as a flip."""

FLIP_MM = 100.0


def mpjpe(estimate: np.ndarray, truth: np.ndarray, estimate_root: np.ndarray, truth_root: np.ndarray) -> np.ndarray:
    """(f,) mm: mean distance of the joints per frame, after both roots (f, 3) are moved to the origin.

    Joints with a NaN are left out of the mean. The result is NaN if there is no other joint, for example before a
    person was found.
    """
    difference = (estimate - estimate_root[:, None]) - (truth - truth_root[:, None])
    size = np.linalg.norm(difference, axis=-1)
    known = np.isfinite(size)
    with np.errstate(invalid="ignore"):
        return 1000 * np.where(known, size, 0.0).sum(axis=1) / known.sum(axis=1)


def joint_errors(
    estimate: np.ndarray,
    truth: np.ndarray,
    estimate_root: np.ndarray,
    truth_root: np.ndarray,
    names: Sequence[str],
) -> dict[str, tuple[float, float]]:
    """By joint, without its side: mean distance and mean error along the optical axis, mm, roots at the origin.

    Positions with a NaN are left out, and joints without any other.
    """
    difference = (estimate - estimate_root[:, None]) - (truth - truth_root[:, None])
    sizes = 1000 * np.stack([np.linalg.norm(difference, axis=-1), np.abs(difference[..., 2])], axis=-1)
    kinds = [name.rpartition("_")[2] for name in names]
    result = {}
    for kind in dict.fromkeys(kinds):
        of_kind = sizes[:, [k == kind for k in kinds]].reshape(-1, 2)
        known = of_kind[np.isfinite(of_kind).all(axis=1)]
        if len(known):
            distance, depth = known.mean(axis=0)
            result[kind] = float(distance), float(depth)
    return result


def pa_mpjpe(estimate: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """(f,) mm: the same after the best similarity transform (rotation, translation, scale) of each frame's estimate."""
    result = np.empty(len(truth))
    for frame, (source, target) in enumerate(zip(estimate, truth)):
        known = np.all(np.isfinite(source) & np.isfinite(target), axis=-1)
        aligned = procrustes(source[known], target[known])
        result[frame] = 1000 * np.mean(np.linalg.norm(aligned - target[known], axis=-1))
    return result


def procrustes(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """`source` (j, 3) after the similarity transform without reflection to `target` (Umeyama 1991)."""
    source_mean, target_mean = source.mean(0), target.mean(0)
    centred = source - source_mean
    U, S, Vt = np.linalg.svd(centred.T @ (target - target_mean))
    signs = np.ones(3)
    signs[2] = np.sign(np.linalg.det(U @ Vt))
    scale = (S * signs).sum() / max(float(np.sum(centred * centred)), 1e-300)
    return scale * (centred @ ((U * signs) @ Vt)) + target_mean


def acceleration_error(
    estimate: np.ndarray, truth: np.ndarray, estimate_root: np.ndarray, truth_root: np.ndarray, fps: float
) -> float:
    """m/s^2: mean norm of the second difference of the root-aligned joints' error, times fps^2. Frames contiguous."""
    error = (estimate - estimate_root[:, None]) - (truth - truth_root[:, None])
    second = np.diff(error, 2, axis=0)
    return float(np.nanmean(np.linalg.norm(second, axis=-1)) * fps * fps) if len(second) else float("nan")


def flipped_frames(estimate: np.ndarray, truth: np.ndarray, names: Sequence[str]) -> np.ndarray:
    """(f,) bool: frames in which a limb points to the wrong side in depth.

    A limb bone of `LIMBS` is flipped if z(distal) - z(proximal) has the opposite sign of the truth's and differs from
    it by more than 100 mm.
    """
    index = {name: i for i, name in enumerate(names)}
    limbs = [(index[a], index[b]) for a, b in LIMBS if a in index and b in index]
    proximal, distal = (list(side) for side in zip(*limbs))
    mine = estimate[:, distal, 2] - estimate[:, proximal, 2]
    true = truth[:, distal, 2] - truth[:, proximal, 2]
    wrong = (np.sign(mine) != np.sign(true)) & (1000 * np.abs(mine - true) > FLIP_MM)
    return np.any(wrong, axis=1)


def yaw_error(estimate: np.ndarray, truth: np.ndarray, names: Sequence[str]) -> np.ndarray:
    """(f,) degrees, 0 to 180: angle between the two pelvises' left axes (right to left hip) in the top view."""
    left, right = list(names).index("l_hip"), list(names).index("r_hip")
    mine = (estimate[:, left] - estimate[:, right])[:, [0, 2]]
    true = (truth[:, left] - truth[:, right])[:, [0, 2]]
    cross = mine[:, 0] * true[:, 1] - mine[:, 1] * true[:, 0]
    return np.degrees(np.abs(np.arctan2(cross, np.sum(mine * true, axis=-1))))


def figures(
    estimate: np.ndarray,
    truth: np.ndarray,
    estimate_root: np.ndarray,
    truth_root: np.ndarray,
    names: Sequence[str],
    stamps: np.ndarray,
    fps: float,
) -> dict[str, Any]:
    """The figures of f frames, some of which are known: those with a root (f, 3) of the truth. stamps: (f,) s."""
    scored = np.isfinite(truth_root).all(axis=1)
    known = estimate[scored], truth[scored], estimate_root[scored], truth_root[scored]
    error, flips = mpjpe(*known), flipped_frames(*known[:2], names)
    return {
        "frames": int(scored.sum()),
        "mpjpe_mm": float(np.mean(error)),
        "pa_mpjpe_mm": float(np.mean(pa_mpjpe(*known[:2]))),
        "root_mm": float(1000 * np.mean(np.linalg.norm(known[2] - known[3], axis=-1))),
        "accel_error": acceleration_error(estimate, truth, estimate_root, truth_root, fps),
        "frames_over_100mm": int(np.sum(error > 100)),
        "over_100mm_percent": float(100 * np.mean(error > 100)),
        "flips": int(np.sum(flips)),
        "flips_percent": float(100 * np.mean(flips)),
        "joints_mm": joint_errors(*known, names),
        **body_figures(estimate, truth, names, stamps),
    }
