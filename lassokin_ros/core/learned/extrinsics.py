"""The places of the cameras, learned from the person whom they see.

The pose of each camera but one, the anchor, gets a correction in that camera's frame, x_c' = exp(w) x_c + v. It
minimises the distances of the landmarks from the epipolar lines of the anchor's (Sampson's approximation), over frames
of the last seconds, with a prior around the given pose. The person's size fixes the scale, which epipolar lines do not
show.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.image.frame_data import FrameData, View
from lassokin_ros.core.image.projection import MEDIAN_OF_NORMAL
from lassokin_ros.core.learned.camera_finder import CameraFinder
from lassokin_ros.core.learned.height import SizeCheck
from lassokin_ros.core.observation import CameraPose, has_passed

GIVEN_DEVIATION = np.array([0.035, 0.035, 0.035, 0.03, 0.03, 0.03])
"""rad and m: standard deviation of a given pose, for rotation and translation. Absolute error, one of two cameras 3 cm
and 2 degrees off: 48 mm with the learned pose, 103 with the given one."""
EXACT = 0.3
"""Size of a correction, in GIVEN_DEVIATION, of which half is used. Those of exact poses are noise, of 0.1 to 0.3; poses
that are 3 cm and 2 degrees off give 0.7 to 1.0. Absolute error from exact poses: 19.2 mm with, 21.0 without; from
those poses 47.7 and 48.8."""
FOUND_DEVIATION = np.array([1.0, 1.0, 1.0, 3.0, 3.0, 3.0])
"""rad and m: the same of a pose that was found from the person: it does not count."""
TURNED, SHIFTED = np.array(3 * [1.0] + 3 * [1e-6]), np.array(3 * [1e-6] + 3 * [3.0])
"""rad and m: as FOUND_DEVIATION, for a camera that was only turned, and for one that was only shifted."""
LATELY = 6
"""Frames that show at once that a camera was moved."""
LATELY_DEVIATION = 3 * GIVEN_DEVIATION
"""rad and m: standard deviation of a pose in these."""
CHANGED, CONTRADICTS = 0.75, 1.2
"""Sizes, in GIVEN_DEVIATION, of what the last frames suggest beyond what all frames before did: half of it is used in
the covariance, and from which on the cameras are said to contradict each other. A detector's errors cause 0.3 to 0.9, a
camera that was turned by 3 degrees 1.5 (people of validation)."""
LEAST_CHANGE, UNSURE, FARTHEST_OFF = 0.4, 0.5, 2.0
"""The same, below which nothing is added to the covariance, and by how much it may be larger; and m, limit of the
deviation that is added."""
IMPLAUSIBLE = 2.2
"""The same, from which on the first frames do not count as those before."""
USUAL = 25
"""Corrections suggested before, of which the mean is taken; a camera that was moved does not change it."""
CLEARLY = 2.0
"""Ratio of the median distances from the epipolar lines from which one explanation is said to be right. A turn and a
shift look alike if the person stays in one place: 1 m and 15 degrees at 3.6 m have ratios of up to 2, with a person who
walks 2 m to and fro 8 to 10."""
SIZE_DEVIATION = 0.1
"""Standard deviation of the logarithm of the person's size, with that of the proportions."""
PERIOD_S, LONGEST = 0.1, 200
"""s between two frames that are kept; frames that are kept."""
SOLVED_EVERY, CHECKED_EVERY = 5, 20
"""Kept frames between two solutions, if poses are corrected, and if they are only checked."""
THINNED = 4
"""Of so many kept frames, one is used for explanations. They then take about 15 ms, each CHECKED_EVERY frames."""
FEWEST, FEWEST_POINTS = 10, 6
"""Frames before there is a correction; common landmarks of a frame that is kept."""
OUTLIER = 3.0
"""Distance r from an epipolar line, in standard deviations, from which its weight decreases, with r^-2."""
FOLLOWING = 0.1
"""Share of the way to the solution that a correction moves in PERIOD_S, so that the body does not jump."""
MOVED = math.radians(1.5), 0.05
"""rad, m: corrections beyond which a camera is said to have been moved. From exact poses they reach 1 degree, 3 cm."""
FOUND = 0.015
"""Misfit of a pose (the median distance from the epipolar lines, as a fraction of the person's size in the image, and
half the logarithm of the person's size in space) below which a pose that was found from the person is used. It is at
most 0.011 in validation and for the pairs of cameras of Shelf's recording, and 0.02 or more (42 pairs of people) if
each camera sees another person."""
LEAST_SHARE = 0.5
"""Share of the limbs that must have a plausible length, so that an explanation counts."""


class Pairs(NamedTuple):
    """Frames that two cameras have seen; one frame without the first axis.

    a, b: (f, l, 2) normalised points of both. weights: (f, l) of their difference. rotation: (f, 3, 3) and translation:
    (f, 3) m, from the first to the second camera.
    """

    a: np.ndarray
    b: np.ndarray
    weights: np.ndarray
    rotation: np.ndarray
    translation: np.ndarray


class Extrinsics:
    """Corrections of the poses of all cameras but one."""

    def __init__(self, size: SizeCheck, size_known: bool, used: bool) -> None:
        """size_known: whether the person's height is given. used: whether poses are corrected, or only checked."""
        self._size, self.size_known, self._used = size, size_known, used
        self.corrections: dict[str, np.ndarray] = {}
        """(6,) rotation vector w, rad, and translation v, m, by camera: as used."""
        self.anchor: str | None = None
        """Name of the camera whose pose is right; None to choose it by the poses."""
        self._solutions: dict[str, np.ndarray] = {}
        self._explanations: dict[str, list[tuple[np.ndarray, float]]] = {}
        # (6,) correction and misfit of a camera that was turned, one that was shifted, and one that was both, by name
        self._given: dict[str, CameraPose] = {}
        self.found: dict[str, CameraPose] = {}
        """Poses of cameras without a given one, by name, from the first frames with the person."""
        self.reset()

    def reset(self, same_camera: bool = False) -> None:
        """Forget the frames. Found poses stay with their corrections.

        same_camera: keep the other corrections, too, because cameras do not move with the person.
        """
        if not same_camera:
            for known in (self._solutions, self._explanations, self.corrections):
                for name in known.keys() - self.found.keys():
                    known.pop(name)  # type: ignore[attr-defined]
        self._frames: dict[str, deque[Pairs]] = {}
        self._finders: dict[str, CameraFinder] = {}
        self._newest, self.frame_count = -math.inf, 0
        self._lately: dict[str, deque[Pairs]] = {}
        self._suggested: dict[str, np.ndarray] = {}  # (6,) correction that the last frames suggest, by camera
        self._usual: dict[str, tuple[np.ndarray, int]] = {}  # (6,) mean of those before, and their number
        self.moves: dict[str, np.ndarray] = {}
        """(6,) by how much a camera was moved lately, relative to the anchor, as the last frames suggest, by name."""
        self._first = ""  # the anchor of these

    def adopt(self, other: Extrinsics) -> None:
        """Begin with what was learned about the same cameras."""
        self.found, self.corrections, self._solutions = {**other.found}, {**other.corrections}, {**other._solutions}
        self._frames = {name: frames.copy() for name, frames in other._frames.items()}

    def move_frame(self, moved: CameraPose) -> None:
        """Keep found cameras where they are, although the frame has moved: x is at `moved.into_camera(x)` now."""
        for name, pose in self.found.items():
            self.found[name] = self._given[name] = pose.after(moved.inverse)
        self._finders.clear()

    def resize(self, ratio: float, centre: np.ndarray | None) -> None:
        """See `CameraFinder.resize`."""
        for finder in self._finders.values():
            finder.resize(ratio, centre)

    def corrected(self, pose: CameraPose) -> CameraPose:
        """Return a given pose with the correction of its camera; for an unknown pose, the found one with it, if any.

        The correction of a found pose is not that of one that is given in its place.
        """
        pose = pose if pose.known else self.found.get(pose.name, pose)
        corrected = self._used and pose.known and not self._replaces_found(pose)
        correction = self.corrections.get(pose.name) if corrected else None
        return pose if correction is None else _moved(pose, correction)

    def received(self, pose: CameraPose) -> CameraPose:
        """As `corrected`, for the pose of a new observation. A found pose is forgotten if another one is given now."""
        if self._replaces_found(pose):
            for known in (self.found, self._frames, self._solutions, self._explanations, self.corrections):
                known.pop(pose.name, None)  # type: ignore[attr-defined]
        used = pose if pose.known else self.found.get(pose.name, pose)
        if used.known:
            self._given[pose.name] = used
        return self.corrected(used)

    def given(self, pose: CameraPose) -> CameraPose:
        """Return the pose of a camera, as `received` has returned it, without its correction."""
        return self._given.get(pose.name, pose)

    def _replaces_found(self, pose: CameraPose) -> bool:
        """Whether a camera with a found pose has another one that is given."""
        found = self.found.get(pose.name, pose)
        if not pose.known or pose is found:
            return False
        same = np.array_equal(pose.rotation, found.rotation) and np.array_equal(pose.translation, found.translation)
        return not same

    def find(self, name: str, stamp: float, views: tuple[View, View], joints: tuple[np.ndarray, np.ndarray]) -> None:
        """Use a frame of a camera without a pose, see `CameraFinder.add`. The pose is used if the keypoints fit it."""
        finder = self._finders.setdefault(name, CameraFinder(PERIOD_S, LONGEST))
        if not finder.add(stamp, views, joints):
            return
        pose = finder.pose(name)
        frames = _entries(finder, pose)
        if len(frames) < FEWEST:
            return
        pose = _moved(pose, self._solved(_stacked(frames), np.zeros(6), FOUND_DEVIATION, sized=True, steps=15))
        frames = _entries(finder, pose)
        if self._misfit(_stacked(frames)) < FOUND:
            self.found[name], self._frames[name] = pose, frames
            del self._finders[name]

    def learned(self, pose: CameraPose) -> CameraPose:
        """Return a given pose with what was learned about its camera, also if it is only checked."""
        solution = self._solutions.get(pose.name)
        return pose if solution is None else _moved(pose, solution)

    def moved(self, name: str) -> tuple[float, float] | None:
        """Return by how much a camera is elsewhere than given, rad and m; None if it is where it should be."""
        solution = self.solution(name)
        return solution if solution is not None and (solution[0] > MOVED[0] or solution[1] > MOVED[1]) else None

    def solution(self, name: str) -> tuple[float, float] | None:
        """Return by how much a camera's pose differs from the given one, rad and m; None before it is known."""
        found = self._solutions.get(name)
        return None if found is None else _size(found)

    def in_words(self, name: str) -> str:
        """Return by how much the given pose of a camera is off; empty if it is not."""
        moved = self.moved(name)
        if moved is None or name in self.found:
            return ""
        if self._used:
            off, done = f"{math.degrees(moved[0]):.1f} degrees and {moved[1]:.2f} m", ""
        else:
            off, done = f"about {self._explained(name)}", "not "
        done = f"this is {done}corrected (see extrinsics)"
        return f"camera '{name}': the keypoints suggest that its pose is off by {off}; {done}"

    def _explained(self, name: str) -> str:
        """Return by how much a camera is turned or shifted, in words: both values if it cannot be told which."""
        (turned, turn), (shifted, shift), (moved, both) = self._explanations[name]
        degrees, metres = f"{math.degrees(_size(turned)[0]):.0f} degrees", f"{_size(shifted)[1]:.1f} m"
        if min(turn, shift) > CLEARLY * both:
            angle, distance = _size(moved)
            return f"{math.degrees(angle):.0f} degrees and {distance:.1f} m"
        if turn > CLEARLY * shift:
            return metres
        return degrees if shift > CLEARLY * turn else f"{degrees} or {metres}"

    def update(self, stamp: float, frame: FrameData) -> None:
        """Use a frame with the views of all cameras. stamp: s."""
        if not has_passed(stamp - self._newest, PERIOD_S):
            return
        self._newest, first = stamp, self._anchor_of(frame)
        if first is None or first.camera.name not in self._given:
            return  # the camera whose pose is right has not been seen
        others = [view for view in frame.views if view is not first and view.camera.name in self._given]
        anchor = self._given[first.camera.name]
        seen = {view.camera.name: _pair(first, view, self._given[view.camera.name], anchor) for view in others}
        self.frame_count += any(seen.values())
        due = self.frame_count % (SOLVED_EVERY if self._used else CHECKED_EVERY) == 0
        for name, pair in seen.items():
            if pair is None:
                continue
            self._look(name, first.camera.name, pair)
            frames = self._frames.setdefault(name, deque(maxlen=LONGEST))
            frames.append(pair)
            if due and len(frames) >= FEWEST:
                pairs, before = _stacked(frames), self._solutions.get(name, np.zeros(6))
                found = name in self.found
                deviation = FOUND_DEVIATION if found else GIVEN_DEVIATION
                self._solutions[name] = self._solved(pairs, before, deviation, found or self.size_known)
                if not self._used and self.moved(name) is not None:
                    self._explain(_stacked(list(frames)[::THINNED]), name)
        for name, solution in self._solutions.items():
            before = self.corrections.get(name, np.zeros(6))
            wanted = solution if name in self.found else _significant(solution)
            self.corrections[name] = before + FOLLOWING * (wanted - before)

    def _look(self, name: str, first: str, pair: Pairs) -> None:
        """Find by how much a camera was moved lately. first: name of the anchor."""
        frames = self._lately.setdefault(name, deque(maxlen=LATELY))
        frames.append(pair)
        if name in self.found or len(frames) < LATELY or self.frame_count % 2:
            return
        start = self._suggested.get(name, np.zeros(6))
        suggested = self._solved(_stacked(frames), start, LATELY_DEVIATION, self.size_known, steps=2)
        self._suggested[name], self._first = suggested, first
        if self._used:
            self.moves[name] = suggested - self.corrections.get(name, np.zeros(6))
            return
        usual, count = self._usual.get(name, (np.zeros(6), 0))
        plausible = _relative(suggested) < IMPLAUSIBLE
        if count >= FEWEST or not plausible:
            self.moves[name] = suggested - usual
        if plausible and (count < FEWEST or _relative(self.moves[name]) < CHANGED):
            self._usual[name] = usual + (suggested - usual) / min(count + 1, USUAL), count + 1

    @property
    def contradicting(self) -> list[str]:
        """Names of the cameras that contradict the anchor since a moment: they were moved, or it was."""
        return [name for name, move in self.moves.items() if _relative(move) > CONTRADICTS]

    @property
    def contradiction(self) -> str:
        """Which camera was moved, in words; empty if none was.

        Of two cameras it cannot be told which one. If several contradict the anchor, it was the anchor.
        """
        names = self.contradicting
        if not names:
            return ""
        largest = max((self.moves[name] for name in names), key=_relative)
        by = f"about {math.degrees(_size(largest)[0]):.0f} degrees or {_size(largest)[1]:.2f} m"
        if len(self.moves) == 1:
            return f"cameras '{self._first}' and '{names[0]}' contradict each other: one of them was moved, by {by}"
        moved = names[0] if len(names) == 1 else self._first
        return f"camera '{moved}' contradicts the others: it was moved, by {by}"

    def place_covariance(self, place: np.ndarray) -> np.ndarray | None:
        """(3, 3) m^2: how far a place (3,) m is elsewhere with the poses that the last frames suggest; None if nowhere.

        It is where the line of sight of the moved camera meets the anchor's. Either of both may have been moved, so
        that the place is off in all directions of the plane of the two lines.
        """
        anchor, found = self._given.get(self._first), np.zeros((3, 3))
        for name, move in self.moves.items():
            given, size = self._given.get(name), _relative(move)
            if anchor is None or given is None or size < LEAST_CHANGE:
                continue
            share = size**4 / (size**4 + CHANGED**4) * (1 + UNSURE / size)
            seen = _moved(given, share * move)
            a, b = place - anchor.centre, seen.rotation.T @ (given.rotation @ (place - given.centre))
            normal = np.cross(a, b)
            if not normal.any():
                continue
            s, t, _ = np.linalg.solve(np.stack([a, -b, normal], axis=1), seen.centre - anchor.centre)
            off = 0.5 * (anchor.centre + s * a + seen.centre + t * b) - place
            normal = normal / np.linalg.norm(normal)
            found += min(off @ off, FARTHEST_OFF**2) * (np.eye(3) - np.outer(normal, normal))
        return found if found.any() else None

    def _anchor_of(self, frame: FrameData) -> View | None:
        """Return the view of the camera whose pose is not corrected: the chosen one, None if it has none; without a
        choice the one in whose frame the skeleton is, or the first.
        """
        views = frame.views
        if self.anchor is None:
            given = [self._given.get(view.camera.name) for view in views]
            return next((view for view, pose in zip(views, given) if pose and pose.is_identity), views[0])
        return next((view for view in views if view.camera.name == self.anchor), None)

    def _misfit(self, pairs: Pairs) -> float:
        """Return the misfit of a pose, see FOUND; infinite if half of the limbs have no plausible length."""
        distances, size, plausible = self._residuals(pairs, np.zeros(6))
        seen = pairs.weights > 0
        if plausible < LEAST_SHARE:
            return math.inf
        shown = np.where(seen[..., None], pairs.b, np.nan)
        extent = np.linalg.norm(np.nanmax(shown, axis=1) - np.nanmin(shown, axis=1), axis=-1)[:, None]
        apart = float(np.median((np.abs(distances) / np.maximum(pairs.weights, 1e-9) / extent)[seen]))
        return apart + 0.5 * abs(size) * self.size_known

    def _explain(self, pairs: Pairs, name: str) -> None:
        """Fit a turn, a shift, and both, without regard to the given pose."""
        before, found = self._explanations.get(name, 3 * [(np.zeros(6), 0.0)]), []
        for (start, _), deviation in zip(before, (TURNED, SHIFTED, FOUND_DEVIATION)):
            solution = self._solved(pairs, start, deviation, self.size_known)
            distances, *_ = self._residuals(pairs, solution)
            found.append((solution, float(np.median(np.abs(distances[pairs.weights > 0])))))
        self._explanations[name] = found

    def _solved(
        self, pairs: Pairs, correction: np.ndarray, deviation: np.ndarray, sized: bool, steps: int = 3
    ) -> np.ndarray:
        """Return the correction (6,) that fits all frames best, by Gauss-Newton from a start.

        deviation: (6,) of the given pose. sized: whether the size of the body in use counts: it is given, or was
        measured by other cameras.
        """
        share = math.sqrt(1 / len(pairs.a))  # all frames count as one: the errors of a detector last
        seen, step = pairs.weights.reshape(-1) > 0, 1e-5
        for _ in range(steps):
            base = self._residuals(pairs, correction)
            moved = [self._residuals(pairs, correction + step * unit) for unit in np.eye(6)]
            J = np.stack([(one[0] - base[0]) / step for one in moved], axis=-1).reshape(-1, 6)
            r = base[0].reshape(-1)
            # Errors that are larger than configured count less.
            scale = max(1.0, float(np.median(np.abs(r[seen]))) / MEDIAN_OF_NORMAL)
            J, r = J / scale, r / scale
            robust = share * np.minimum(1.0, OUTLIER / np.maximum(np.abs(r), 1e-9))
            J, r = J * robust[:, None], r * robust
            H, g = J.T @ J, J.T @ r
            H[np.arange(6), np.arange(6)] += 1 / deviation**2
            g += correction / deviation**2
            if sized:
                row = np.array([(one[1] - base[1]) / step for one in moved]) / SIZE_DEVIATION
                H += np.outer(row, row)
                g += row * base[1] / SIZE_DEVIATION
            correction = correction - np.linalg.solve(H, g)
        return correction

    def _residuals(self, pairs: Pairs, correction: np.ndarray) -> tuple[np.ndarray, float, float]:
        """Return (f, l) distances from epipolar lines in standard deviations, and what `_log_size` returns."""
        weights, turn = pairs.weights, exponential(correction[None, :3])[0]
        R, t = turn @ pairs.rotation, pairs.translation @ turn.T + correction[3:]
        ones = np.ones((*weights.shape, 1))
        x, y = np.concatenate([pairs.a, ones], -1), np.concatenate([pairs.b, ones], -1)
        turned = x @ R.swapaxes(1, 2)
        line_b = np.cross(t[:, None], turned)
        line_a = np.cross(y, t[:, None]) @ R
        scale = np.sqrt((line_b[..., :2] ** 2).sum(-1) + (line_a[..., :2] ** 2).sum(-1))
        distances = weights * (y * line_b).sum(-1) / np.maximum(scale, 1e-9)
        return distances, *self._log_size(turned, y, t, weights > 0)

    def _log_size(self, turned: np.ndarray, y: np.ndarray, t: np.ndarray, seen: np.ndarray) -> tuple[float, float]:
        """Return the median logarithm of measured / given length of the limbs, and the share of limbs before both
        cameras and with a plausible length. A landmark is where its lines of sight meet, p = s R x + t and q = u y.
        """
        xx, yy, xy = (turned * turned).sum(-1), (y * y).sum(-1), (turned * y).sum(-1)
        xt, yt = (turned * t[:, None]).sum(-1), (y * t[:, None]).sum(-1)
        u = (xx * yt - xy * xt) / np.maximum(xx * yy - xy * xy, 1e-9)
        s = (xy * yt - yy * xt) / np.maximum(xx * yy - xy * xy, 1e-9)  # p = s R x + t is before the first camera, too
        found = self._size.ratios(u[..., None] * y, seen & (u > 0) & (s > 0))
        plausible = len(found) / max(self._size.limb_count(seen), 1)
        return (math.log(float(np.median(found))) if len(found) else 0.0), plausible


def _stacked(frames: Iterable[Pairs]) -> Pairs:
    return Pairs(*(np.stack(parts) for parts in zip(*frames)))


def _entries(finder: CameraFinder, pose: CameraPose) -> deque[Pairs]:
    """Frames of a camera with a found pose, as `Extrinsics` keeps them."""
    pairs = (_pair(placed, unplaced, pose, placed.camera) for placed, unplaced in finder.views)
    return deque(filter(None, pairs), maxlen=LONGEST)


def _pair(a: View, b: View, pose: CameraPose, first: CameraPose) -> Pairs | None:
    """The landmarks that both views show; None for too few. pose, first: of their cameras."""
    both = (a.weights > 0) & (b.weights > 0)
    if np.count_nonzero(both) < FEWEST_POINTS:
        return None
    weights = np.where(both, 1 / np.hypot(1 / np.maximum(a.weights, 1e-9), 1 / np.maximum(b.weights, 1e-9)), 0.0)
    relative = pose.relative_to(first)
    return Pairs(a.points, b.points, weights, relative.rotation, relative.translation)


def _significant(correction: np.ndarray) -> np.ndarray:
    """The part of a correction (6,) of a given pose that is used, see EXACT."""
    size = float(np.linalg.norm(correction / GIVEN_DEVIATION)) ** 4
    return size / (size + EXACT**4) * correction


def _relative(correction: np.ndarray) -> float:
    """Return the size of a correction (6,), in GIVEN_DEVIATION."""
    return float(np.linalg.norm(correction / GIVEN_DEVIATION))


def _size(correction: np.ndarray) -> tuple[float, float]:
    """rad and m, of a correction (6,)."""
    return float(np.linalg.norm(correction[:3])), float(np.linalg.norm(correction[3:]))


def _moved(pose: CameraPose, correction: np.ndarray) -> CameraPose:
    turn = exponential(correction[None, :3])[0]
    return CameraPose(
        pose.name, turn @ pose.rotation, turn @ pose.translation + correction[3:], deviation=pose.deviation
    )
