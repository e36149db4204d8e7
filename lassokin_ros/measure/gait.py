"""Steps, strides, speed and knees of a person who walks, of each side, with the deviations of what one camera sees."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from lassokin_ros.measure.gait_events import SHORTEST_STRIDE_S, Walk, walk_of
from lassokin_ros.measure.poses import SIDES, MeasureError, Poses
from lassokin_ros.replay.exports.named_angles import angles_of

LONGEST_STRIDE_S, LONGEST_STEP_S = 2.5, 1.25
LONGEST_STRIDE, LONGEST_STEP = 1.6, 0.8
"""Longest stride and step, as shares of the median stride: a longer one hides an event that was missed."""
ABOUT_S = 0.1
"""s before and after an event in which no frame may be marked or hidden."""
TURNED = np.radians(30.0)
"""Change of the direction of travel above which a step belongs to a turn."""
FOOTPRINT_S = (0.08, 0.28)
"""s after a strike between which the ankle of the foot on the floor gives the footprint."""
POINTS = 101
"""Points of a curve from one strike to the next."""
SIDE, OBLIQUE, ALONG, SEVERAL = "side", "oblique", "along", "several cameras"
VIEWS: Mapping[str, tuple[float, float]] = {ALONG: (0, 30), OBLIQUE: (30, 60), SIDE: (60, 90.1)}
"""Degrees between the line of sight and the way."""
TIME, LENGTH, STANCE = "step time", "step length", "stance"
DEVIATIONS: Mapping[str, Mapping[str, tuple[float, float]]] = {
    TIME: {SIDE: (0.036, 0.046), OBLIQUE: (0.056, 0.075), ALONG: (0.053, 0.068), SEVERAL: (0.036, 0.046)},
    LENGTH: {SIDE: (0.045, 0.043), OBLIQUE: (0.087, 0.076), SEVERAL: (0.045, 0.043)},
    STANCE: {SIDE: (0.04, 0.019), OBLIQUE: (0.053, 0.043), ALONG: (0.09, 0.043), SEVERAL: (0.04, 0.019)},
}
"""Standard deviation of one step's measure, and of left - right for one step each: s, m, share of the stride.

Of 13 people (`benchmarks/gait.py`, which tests them on each person with those of the others). Those of several cameras
are those from the side.
"""
MOST_STEPS = 6
"""Steps by which a deviation falls; after that, errors that all steps share remain."""
SURE, SEEN = 1.96, 1.64
"""Deviations of an interval of 95 %, and of a bound that 95 % stay below."""
WALK_RATIO, SLOW_MOTION = 0.0065, 0.009
"""m min: usual step length per cadence (N. Sekiya, H. Nagasaki, Reproducibility of the walking patterns of normal young
adults, Gait & Posture 7, 1998); above the second the video plays slower than the person walked."""


@dataclass(frozen=True)
class Sides:
    """One measure of the left and the right foot. Units: s, m, or share of the stride; NaN = not measured.

    mean, deviation, count: of each side; count: steps. spread: of left - right, deviation.
    """

    mean: tuple[float, float]
    deviation: tuple[float, float]
    count: tuple[int, int]
    spread: float

    @property
    def asymmetry(self) -> float:
        """Left - right as a share of their mean."""
        return (self.mean[0] - self.mean[1]) / float(np.mean(self.mean))

    @property
    def below(self) -> float:
        """Share of the mean below which the asymmetry is, at 95 %."""
        return abs(self.asymmetry) + SEEN * self.spread / float(np.mean(self.mean))

    @property
    def differs(self) -> bool:
        """Whether the sides differ, at 95 %."""
        return abs(self.mean[0] - self.mean[1]) > SURE * self.spread


@dataclass(frozen=True, eq=False)
class Gait:
    """The measures of a walk; NaN where there is no whole stride. A leg that no keypoint shows has none.

    strikes, offs: s, foot strikes and toe-offs of each side. strides: number of whole strides. cadence: steps per
    minute, of the mean stride. stride_s, stride_m: mean time and length of a stride; on a treadmill the length is about
    0. speed: m/s. sides: `Sides` by the names `TIME`, `LENGTH`, `STANCE`. steps: by name and side, of each step the
    time of the strike, s, the value and the view. double_support: share of a stride in which both feet are on the
    floor, of both sides together. knee_range: degrees between the smallest and the largest flexion of a stride, median
    of each side. knees: (strides, 101) degrees of each side, from strike to strike. view: the most frequent one.
    left_out: steps that do not count, by the reason. doubtful: share of the frames that the report marks.
    """

    strikes: dict[str, np.ndarray]
    offs: dict[str, np.ndarray]
    strides: int
    cadence: float
    stride_s: float
    stride_m: float
    speed: float
    sides: dict[str, Sides]
    steps: dict[str, dict[str, list[tuple[float, float, str]]]]
    double_support: float
    knee_range: dict[str, float]
    knees: dict[str, np.ndarray]
    view: str
    left_out: dict[str, int]
    doubtful: float

    @property
    def slow_motion(self) -> float:
        """About how many times slower the video plays; 0 if nothing speaks for slow motion."""
        ratio = 0.5 * self.stride_m / self.cadence
        return ratio / WALK_RATIO if ratio > SLOW_MOTION else 0.0


@dataclass
class _Found:
    """What is collected over the parts of all passes."""

    strides: list[tuple[float, float]] = field(default_factory=list)  # s and m
    double_support: list[float] = field(default_factory=list)
    steps: dict[str, dict[str, list[tuple[float, float, str]]]] = field(
        default_factory=lambda: {name: {side: [] for side in SIDES} for name in DEVIATIONS}
    )
    knees: dict[str, list[np.ndarray]] = field(default_factory=lambda: {side: [] for side in SIDES})
    left_out: Counter[str] = field(default_factory=Counter)


def measure_gait(*passes: Poses) -> Gait:
    """Return the measures, with the steps of all passes together. Raises MeasureError if no stride is found."""
    parts = [(one, [(piece, walk_of(piece)) for piece in one.pieces()]) for one in passes]
    return gait_of([(one, piece, walk) for one, pieces in parts for piece, walk in pieces if walk is not None], passes)


def gait_of(parts: Sequence[tuple[Poses, Poses, Walk]], passes: Sequence[Poses]) -> Gait:
    """Return the measures. parts: the pass, its piece without a gap, and the events in it."""
    found = _Found()
    lasts = [b - a for one, _, walk in parts for side in SIDES for a, b in _cycles(one, walk, side)]
    usual = float(np.median(lasts)) if lasts else np.nan
    for one, piece, walk in parts:
        _add_strides(found, one, piece, walk, usual)
        _add_steps(found, one, walk, usual)
    if not found.strides:
        words = "no stride was found: expected a person who walks for two steps or more, with the feet in view"
        left = [f"{number} left out: {reason}" for reason, number in found.left_out.items()]
        raise MeasureError("; ".join([words, *left, *(line for one in passes for line in one.unseen())]))
    stride_s, stride_m = np.mean(found.strides, axis=0).tolist()
    views = [view for steps in found.steps[TIME].values() for _, _, view in steps]
    sides = {name: _sides(name, values) for name, values in found.steps.items()}
    knees = {side: np.array(curves).reshape(-1, POINTS) for side, curves in found.knees.items()}
    return Gait(
        {side: np.concatenate([_strikes(one, side, walk) for one, _, walk in parts]) for side in SIDES},
        {side: np.concatenate([walk.offs[side] for _, _, walk in parts]) for side in SIDES},
        len(found.strides),
        120 / stride_s if max(sides[TIME].count) else float("nan"),
        stride_s,
        stride_m,
        stride_m / stride_s,
        sides,
        found.steps,
        float(np.mean(found.double_support)) if found.double_support else float("nan"),
        {side: float(np.median(np.ptp(curves, axis=1))) if len(curves) else np.nan for side, curves in knees.items()},
        knees,
        max(VIEWS, key=views.count) if SEVERAL not in views else SEVERAL,
        dict(found.left_out),
        float(np.mean(np.concatenate([one.likely_wrong for one in passes]))),
    )


def _strikes(one: Poses, side: str, walk: Walk) -> np.ndarray:
    """Return the strikes, s, of which keypoints show the leg."""
    frames = np.clip(np.searchsorted(one.seconds, walk.strikes[side]), 0, len(one.seconds) - 1)
    return np.asarray(walk.strikes[side][one.shown(side)[frames]])


def _cycles(one: Poses, walk: Walk, side: str) -> list[tuple[float, float]]:
    """Return first and last strike of each stride of one foot, s, with one strike of the other foot between them.

    Of a person of whom keypoints show one leg, without one.
    """
    (other,) = set(SIDES) - {side}
    alone = not one.shown(other).any()
    strikes = _strikes(one, side, walk)
    return [
        (float(a), float(b))
        for a, b in zip(strikes, strikes[1:])
        if SHORTEST_STRIDE_S <= b - a <= LONGEST_STRIDE_S
        and (alone or np.count_nonzero((walk.strikes[other] > a) & (walk.strikes[other] < b)) == 1)
    ]


def _fault(one: Poses, walk: Walk, a: float, b: float, sides: Sequence[str]) -> str:
    """Return why the time between two events does not count; empty if it does."""
    about = (one.seconds >= a - ABOUT_S) & (one.seconds <= b + ABOUT_S)
    if one.likely_wrong[about].any():
        return "marked as likely wrong"
    if not all(one.shown(side)[about].all() for side in sides):
        return "leg hidden"
    begin, end = walk.at(walk.travel, a), walk.at(walk.travel, b)
    turned = np.arctan2(begin[0] * end[1] - begin[1] * end[0], begin @ end)
    return "turning" if abs(turned) > TURNED else ""


def _add_strides(found: _Found, one: Poses, piece: Poses, walk: Walk, usual: float) -> None:
    flexion = angles_of(piece.names, piece.positions)
    for side, other in zip(SIDES, SIDES[::-1]):
        for a, b in _cycles(one, walk, side):
            if b - a > LONGEST_STRIDE * usual or _fault(one, walk, a, b, [side]):
                continue
            way = float(np.linalg.norm((walk.at(walk.hips, b) - walk.at(walk.hips, a))[[0, 2]]))
            found.strides.append((b - a, way))
            at = a + np.linspace(0, 1, POINTS) * (b - a)
            found.knees[side].append(np.interp(at, piece.seconds, flexion[f"{side}_knee flexion"]))
            strike = walk.strikes[other][(walk.strikes[other] > a) & (walk.strikes[other] < b)]
            off, others = (walk.offs[name] for name in (side, other))
            own = off[(off > a + 0.15) & (off < b - 0.1)]
            if len(own) == 1:
                found.steps[STANCE][side].append((a, float(own[0] - a) / (b - a), _view(one, walk, a)))
            before = others[(others > a - 0.1) & (others < a + 0.5 * (b - a))]
            if len(own) == len(before) == len(strike) == 1 and not _fault(one, walk, a, b, SIDES):
                found.double_support.append(float(before[0] - a + own[0] - strike[0]) / (b - a))


def _add_steps(found: _Found, one: Poses, walk: Walk, usual: float) -> None:
    longest = LONGEST_STEP_S if np.isnan(usual) else min(LONGEST_STEP * usual, LONGEST_STEP_S)
    events = sorted((float(at), side) for side in SIDES for at in walk.strikes[side])
    for (a, one_side), (b, side) in zip(events, events[1:]):
        if one_side == side or not 0.5 * SHORTEST_STRIDE_S <= b - a <= longest:
            continue
        if fault := _fault(one, walk, a, b, SIDES):
            found.left_out[fault] += 1
            continue
        view = _view(one, walk, b)
        found.steps[TIME][side].append((b, b - a, view))
        if (length := _step_length(walk, (a, one_side), (b, side), view)) is not None:
            found.steps[LENGTH][side].append((b, length, view))


def _step_length(walk: Walk, before: tuple[float, str], strike: tuple[float, str], view: str) -> float | None:
    """Return the way from one foot to the other along the travel, m; None where the view does not show it.

    From the side it is the mean of the feet's distance at the strike and of that of the footprints.
    """
    (a, one), (b, side) = before, strike
    way = np.insert(walk.at(walk.travel, b), 1, 0.0)
    apart = float(way @ (walk.at(walk.ankles[side], b) - walk.at(walk.ankles[one], b)))
    if view == ALONG:
        return None
    if view == OBLIQUE or b + FOOTPRINT_S[0] > walk.seconds[-1]:
        return apart
    prints = [_footprint(walk, name, at) for name, at in ((side, b), (one, a))]
    return 0.5 * (apart + float(way @ (prints[0] - prints[1])))


def _footprint(walk: Walk, side: str, strike: float) -> np.ndarray:
    during = (walk.seconds >= strike + FOOTPRINT_S[0]) & (walk.seconds <= strike + FOOTPRINT_S[1])
    return np.asarray(np.median(walk.ankles[side][during], axis=0))


def _view(one: Poses, walk: Walk, at: float) -> str:
    """Return from where the camera sees the person at a time."""
    if one.cameras > 1:
        return SEVERAL
    sight = walk.at(walk.hips, at)[[0, 2]]
    cosine = abs(sight @ walk.at(walk.travel, at)) / max(float(np.linalg.norm(sight)), 1e-9)
    degrees = np.degrees(np.arccos(min(cosine, 1.0)))
    return next(name for name, (low, high) in VIEWS.items() if low <= degrees < high)


def _sides(name: str, values: Mapping[str, Sequence[tuple[float, float, str]]]) -> Sides:
    """Return the means with deviations that fall with the number of steps, up to `MOST_STEPS`."""
    means, deviations, parts = [], [], 0.0
    for side in SIDES:
        found = values[side]
        ones = np.array([DEVIATIONS[name][view] for _, _, view in found]).reshape(-1, 2)
        scale = np.mean(ones**2, axis=0) / min(len(found), MOST_STEPS) if found else np.full(2, np.nan)
        means.append(float(np.mean([value for _, value, _ in found])) if found else float("nan"))
        deviations.append(float(np.sqrt(scale[0])))
        parts += scale[1]
    count = len(values["left"]), len(values["right"])
    return Sides((means[0], means[1]), (deviations[0], deviations[1]), count, float(np.sqrt(parts)))
