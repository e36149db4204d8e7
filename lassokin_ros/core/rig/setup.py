"""Whether the given places of cameras can be right, as the person whom they see shows.

Each explanation of what may have been given (all poses inverted, one inverted, files exchanged) is scored by the
distances from the epipolar lines, and by the triangulated body: its limbs keep their lengths and have the body's
proportions, it is before the cameras, not mirrored, and equally large for all pairs of cameras. The size is free, so
that it tells the unit of the given places.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations, permutations

import numpy as np

Pose = tuple[np.ndarray, np.ndarray]
"""Rotation (3, 3) into the camera and translation (3,), of one camera; or (f, 3, 3) and (f, 3), in each frame."""
Normalise = Callable[[np.ndarray], np.ndarray]

LIMBS = [
    *((f"{side}_{a}", f"{side}_{b}") for side in ("left", "right") for a, b in (
        ("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle"), ("shoulder", "hip"))),
    ("left_shoulder", "right_shoulder"),
    ("left_hip", "right_hip"),
]  # fmt: skip
TRUNK = ("left_shoulder", "right_shoulder", "left_hip", "right_hip")
FEWEST_FRAMES = 10
"""Frames with six common landmarks of a pair of cameras that are needed."""
WRONG, RIGHT, MAYBE = 0.22, 0.18, 0.14
"""Cost above which the given set-up is wrong; below which another explanation is right; and above which the given one
is wrong if another one has less than half of its cost."""
UNITS = {"m": 1.0, "cm": 100.0, "mm": 1000.0}
"""Units of the places, per m. Of other scales nothing is said."""


@dataclass(frozen=True)
class Explanation:
    """What is given: camera c has the images of file `order[c]`; the poses of the cameras `inverted` are inverse."""

    order: tuple[int, ...]
    inverted: frozenset[int] = frozenset()

    @property
    def exchanged(self) -> list[int]:
        """The cameras whose images are those of another one."""
        return [camera for camera, file in enumerate(self.order) if camera != file]

    @property
    def is_given(self) -> bool:
        """Whether nothing is wrong."""
        return not self.exchanged and not self.inverted


@dataclass(frozen=True, eq=False)
class PairFit:
    """How two cameras fit. distance: from the epipolar lines, of the person's size; NaN terms are not known.

    depth_known: False if the lines of sight are nearly parallel. log_scale: logarithm of the body's triangulated size
    over its real one. up: (3,) mean direction of the trunk in the frame of the places.
    """

    distance: float
    depth_known: bool
    body: float = 0.0
    log_scale: float = 0.0
    up: np.ndarray = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True, eq=False)
class SetUp:
    """The result. costs: of each explanation. found: the one that holds; None if the given one is wrong, and none fits.

    wrong: the one camera, of three or more, without which the others fit; None if there is none. scale: of the places,
    per m; 0 if it is not known. up: (3,) direction of the trunk in the frame of the places, shorter than 1 if it
    varies; zeros if it is not about that of the cameras' images: the person lies.
    """

    costs: Mapping[Explanation, float]
    found: Explanation | None
    wrong: int | None
    scale: float
    up: np.ndarray

    @property
    def unit(self) -> str:
        """The unit of the places; empty if it is none of UNITS."""
        if not self.scale > 0:
            return ""
        return next((name for name, per_m in UNITS.items() if abs(math.log(self.scale / per_m)) < 0.5), "")

    @property
    def axis(self) -> str:
        """The axis along which the person is upright, such as +z; empty if it is none."""
        axis, length = int(np.argmax(np.abs(self.up))), float(np.linalg.norm(self.up))
        if length < 0.5 or abs(self.up[axis]) < 0.75 * length:
            return ""
        return ("+" if self.up[axis] > 0 else "-") + "xyz"[axis]


class SetUpCheck:
    """The keypoints of one person in several cameras at the same instants, and the given set-up."""

    def __init__(
        self,
        pixels: Sequence[np.ndarray],
        known: Sequence[np.ndarray],
        lenses: Sequence[Normalise],
        poses: Sequence[Pose],
        landmarks: Sequence[str],
        rest: np.ndarray,
    ) -> None:
        """pixels: (f, l, 2) and known: (f, l) of each camera. lenses: px (k, 2) to normalised, of each camera.

        landmarks: l names. rest: (l, 3) m, the landmarks of the body at rest, for the lengths.
        """
        self._pixels, self._known, self._lenses, self._poses = pixels, known, lenses, poses
        names = list(landmarks)
        self._landmarks = {name: names.index(name) for name in (*TRUNK, "nose") if name in names}
        limbs = [(names.index(a), names.index(b)) for a, b in LIMBS if {a, b} <= set(names)]
        self._ends = np.array(limbs, dtype=int).reshape(-1, 2).T
        self._lengths = np.linalg.norm(rest[self._ends[0]] - rest[self._ends[1]], axis=-1)
        self._points: dict[tuple[int, int], np.ndarray] = {}
        self._fits: dict[tuple[tuple[int, int, bool], tuple[int, int, bool]], PairFit | None] = {}

    def result(self, searched_from: float = 0.0) -> SetUp | None:
        """Return what the person shows; None if two cameras have too little in common.

        searched_from: cost of what is given above which other explanations are tried, which takes time.
        """
        count = len(self._poses)
        given = Explanation(tuple(range(count)))
        cost = self._cost(given)
        if cost is None:
            return None
        costs = {given: cost}
        if cost > searched_from:
            costs |= {one: self._cost(one) or math.inf for one in self._others(count)}
        found, wrong = self._judged(costs, given)
        fits = [fit for fit in self._pairs(found or given, without=wrong) if fit is not None]
        deep = [fit.log_scale for fit in fits if fit.depth_known]
        scale = math.exp(float(np.median(deep))) if deep and (found or wrong is not None) else 0.0
        up = np.mean([fit.up for fit in fits], axis=0) if fits else np.zeros(3)
        above = -np.mean([np.reshape(rotation, (-1, 3, 3))[:, 1].mean(axis=0) for rotation, _ in self._poses], axis=0)
        upright = float(up @ above) > 0.7 * float(np.linalg.norm(up) * np.linalg.norm(above))  # within 46 degrees
        return SetUp(costs, found, wrong, scale, up if upright else np.zeros(3))

    def _judged(self, costs: Mapping[Explanation, float], given: Explanation) -> tuple[Explanation | None, int | None]:
        """Return the explanation that holds, and the one camera that is wrong."""
        cost = costs[given]
        others = sorted((value, number) for number, (one, value) in enumerate(costs.items()) if one != given)
        if not others:
            return (None if cost > WRONG else given), None
        best, best_one = others[0][0], list(costs)[others[0][1]]
        second = others[1][0] if len(others) > 1 else math.inf
        flat = not any(fit.depth_known for fit in self._pairs(given) if fit is not None)
        # Without depth the cost has no term of the body, and is smaller.
        clearly = best < 0.06 and (best < 0.4 * cost or (flat and cost > 0.03))
        if not (cost > WRONG or (cost > MAYBE and best < 0.5 * cost) or clearly):
            wrong = self._one_wrong(given) if cost > MAYBE else None
            return (given, None) if wrong is None or (self._cost(given, wrong) or 0.0) > 0.5 * cost else (None, wrong)
        if clearly or (best < RIGHT and best < 0.6 * cost and best < 0.8 * second):
            return best_one, None
        return None, self._one_wrong(given)

    def _one_wrong(self, given: Explanation) -> int | None:
        """Return the camera, of three or more, without which the others fit; None if there is none."""
        count = len(self._poses)
        if count < 3:
            return None
        rest = sorted((cost, c) for c in range(count) if (cost := self._cost(given, without=c)) is not None)
        if not rest or rest[0][0] > RIGHT:
            return None
        return rest[0][1] if count == 3 or len(rest) == 1 or rest[0][0] < 0.5 * rest[1][0] else None

    @staticmethod
    def _others(count: int) -> Iterator[Explanation]:
        everything = tuple(range(count))
        yield Explanation(everything, frozenset(everything))
        for camera in everything:
            yield Explanation(everything, frozenset([camera]))
        orders: Iterable[tuple[int, ...]] = permutations(everything)
        if count > 4:  # all of them would take too long
            orders = (_swapped(everything, i, j) for i, j in combinations(everything, 2))
        yield from map(Explanation, sorted(set(orders) - {everything}))

    def _pairs(self, one: Explanation, without: int | None = None) -> list[PairFit | None]:
        cameras = [c for c in range(len(self._poses)) if c != without]
        keys = {c: (one.order[c], c, c in one.inverted) for c in cameras}
        return [self._fit(keys[a], keys[b]) for a, b in combinations(cameras, 2)]

    def _cost(self, one: Explanation, without: int | None = None) -> float | None:
        """Return the cost of an explanation; None if no two cameras have enough in common."""
        fits = [fit for fit in self._pairs(one, without) if fit is not None]
        deep = [fit.log_scale for fit in fits if fit.depth_known]
        if not fits:
            return None
        if not deep:
            return math.inf if not one.is_given else float(np.mean([fit.distance for fit in fits]))
        return float(np.mean([fit.distance + fit.body for fit in fits])) + 0.3 * float(np.ptp(deep))

    def _normalised(self, file: int, camera: int) -> np.ndarray:
        """Return the points (f, l, 2) of a file as that camera's lens sees them."""
        if (file, camera) not in self._points:
            pixels = self._pixels[file]
            self._points[file, camera] = self._lenses[camera](pixels.reshape(-1, 2)).reshape(pixels.shape)
        return self._points[file, camera]

    def _fit(self, first: tuple[int, int, bool], second: tuple[int, int, bool]) -> PairFit | None:
        """Return how two cameras fit; None if they have too little in common. Of each: file, camera, inverted."""
        if (first, second) not in self._fits:
            self._fits[first, second] = self._fitted(first, second)
        return self._fits[first, second]

    def _fitted(self, first: tuple[int, int, bool], second: tuple[int, int, bool]) -> PairFit | None:
        x, y = (self._normalised(file, camera) for file, camera, _ in (first, second))
        known = self._known[first[0]] & self._known[second[0]] & np.isfinite(x[..., 0]) & np.isfinite(y[..., 0])
        frames = known.sum(axis=1) >= 6
        if np.count_nonzero(frames) < FEWEST_FRAMES:
            return None
        x, y = (np.where(known[..., None], points, 0.0)[frames] for points in (x, y))
        known = known[frames]
        (Ra, ta), (Rb, tb) = (_in_frames(self._poses[c], frames, inverted) for _, c, inverted in (first, second))
        rotation = Rb @ Ra.swapaxes(-1, -2)
        translation = tb - _times(rotation, ta)
        base = np.linalg.norm(translation, axis=-1)
        if not float(np.median(base)) > 0:
            return None
        extent = float(np.median([_extent(points, known) for points in (x, y)]))
        u, v = rays(x), rays(y)
        distance = np.abs(sampson(u, v, rotation, translation / np.maximum(base, 1e-12)[..., None]))[known]
        u, v = u @ Ra, v @ Rb
        cosine = (u * v).sum(-1) / np.linalg.norm(u, axis=-1) / np.linalg.norm(v, axis=-1)
        # Lines of sight within 18 degrees show no depth.
        deep = abs(float(np.median(cosine[known]))) < math.cos(math.radians(18))
        fit = PairFit(float(np.median(distance)) / extent, deep)
        if not fit.depth_known:
            return fit
        places, before = _midpoints(u, v, -_times(Ra.swapaxes(-1, -2), ta), -_times(Rb.swapaxes(-1, -2), tb))
        limbs = self._limbs(places, known)
        if limbs is None:
            return PairFit(fit.distance, False)
        scatter, proportions, log_scale = limbs
        up, mirrored = self._trunk(places, known)
        behind = 1 - float(before[known].mean())
        # Weights beside the distance from the epipolar lines, over the person's size in the images.
        body = 0.3 * scatter + 0.15 * proportions + 0.5 * behind + 0.1 * mirrored
        return PairFit(fit.distance, True, body, log_scale, up)

    def _limbs(self, places: np.ndarray, known: np.ndarray) -> tuple[float, float, float] | None:
        """Return how limbs' lengths vary, differ from the body's proportions, and the logarithm of the scale."""
        a, b = self._ends
        both = known[:, a] & known[:, b]
        lengths = np.linalg.norm(places[:, a] - places[:, b], axis=-1)
        seen = both.sum(axis=0) >= FEWEST_FRAMES // 2
        if np.count_nonzero(seen) < 4:  # limbs
            return None
        logs = [np.log(np.maximum(lengths[both[:, limb], limb], 1e-9)) for limb in np.flatnonzero(seen)]
        medians = np.array([np.median(values) for values in logs])
        scatter = 1.48 * float(np.median([np.median(np.abs(values - np.median(values))) for values in logs]))
        ratios = medians - np.log(self._lengths[seen])
        log_scale = float(np.median(ratios))
        return scatter, float(np.median(np.abs(ratios - log_scale))), log_scale

    def _trunk(self, places: np.ndarray, known: np.ndarray) -> tuple[np.ndarray, bool]:
        """Return the mean direction (3,) of the trunk, and whether the person is mirrored: the nose is behind it."""
        if not set(TRUNK) <= set(self._landmarks):
            return np.zeros(3), False
        corners = [self._landmarks[name] for name in TRUNK]
        seen = known[:, corners].all(axis=1)
        if np.count_nonzero(seen) < 5:
            return np.zeros(3), False
        ls, rs, lh, rh = places[seen][:, corners].swapaxes(0, 1)
        up, across = 0.5 * (ls + rs - lh - rh), ls - rs + lh - rh
        mean = (up / np.maximum(np.linalg.norm(up, axis=1, keepdims=True), 1e-9)).mean(axis=0)
        if "nose" not in self._landmarks:
            return mean, False
        nose = self._landmarks["nose"]
        volumes = (np.cross(across, up) * (places[seen][:, nose] - 0.5 * (ls + rs))).sum(-1)[known[seen][:, nose]]
        return mean, len(volumes) > 5 and float(np.mean(volumes < 0)) > 0.7


def _swapped(order: tuple[int, ...], i: int, j: int) -> tuple[int, ...]:
    swapped = list(order)
    swapped[i], swapped[j] = swapped[j], swapped[i]
    return tuple(swapped)


def _in_frames(pose: Pose, frames: np.ndarray, inverted: bool) -> Pose:
    """Return the pose in some frames, or its inverse."""
    rotation, translation = pose
    if rotation.ndim == 3:
        rotation, translation = rotation[frames], translation[frames]
    if inverted:
        rotation, translation = rotation.swapaxes(-1, -2), -_times(rotation.swapaxes(-1, -2), translation)
    return rotation, translation


def _times(matrix: np.ndarray, vector: np.ndarray) -> np.ndarray:
    return np.asarray((matrix @ vector[..., None])[..., 0])


def rays(points: np.ndarray) -> np.ndarray:
    """Return the rays (..., 3) of normalised points (..., 2)."""
    return np.concatenate([points, np.ones((*points.shape[:-1], 1))], -1)


def _extent(points: np.ndarray, known: np.ndarray) -> float:
    """Return the median over the frames of the diagonal of the known points' box."""
    low = np.where(known[..., None], points, np.inf).min(axis=1)
    high = np.where(known[..., None], points, -np.inf).max(axis=1)
    return max(float(np.median(np.linalg.norm(high - low, axis=-1))), 1e-6)


def sampson(u: np.ndarray, v: np.ndarray, rotation: np.ndarray, translation: np.ndarray) -> np.ndarray:
    """Return the distances (f, l), with sign, of rays (f, l, 3) from their epipolar lines (Sampson's approximation).

    rotation: (f, 3, 3) and translation: (f, 3), from the first to the second camera.
    """
    of_second = np.cross(translation[..., None, :], u @ rotation.swapaxes(-1, -2))
    of_first = np.cross(v, translation[..., None, :]) @ rotation
    slope = np.sqrt((of_second[..., :2] ** 2).sum(-1) + (of_first[..., :2] ** 2).sum(-1))
    return np.asarray((v * of_second).sum(-1) / np.maximum(slope, 1e-9))


def _midpoints(u: np.ndarray, v: np.ndarray, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the middles (f, l, 3) between the lines from the centres a, b along u, v, and whether before both."""
    a, b = (np.expand_dims(centre, -2) for centre in (a, b))
    uu, vv, uv, between = (u * u).sum(-1), (v * v).sum(-1), (u * v).sum(-1), b - a
    along_u, along_v = (u * between).sum(-1), (v * between).sum(-1)
    divisor = np.maximum(uu * vv - uv * uv, 1e-9 * uu * vv)
    s, t = (vv * along_u - uv * along_v) / divisor, (uv * along_u - uu * along_v) / divisor
    return 0.5 * (a + s[..., None] * u + b + t[..., None] * v), (s > 0) & (t > 0)
