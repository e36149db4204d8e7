"""The places of the cameras, learned from the person whom they see.

The pose of each camera but one, the anchor, gets a correction (`epipolar_fit.py`) that fits the frames of the last
seconds. A camera without a given pose gets one from the person, too. Whether a camera was moved a moment ago is seen
from the poses that the last frames suggest, compared with those that all frames before did: with a given pose, it could
not be told from a detector's lasting errors.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping

import numpy as np

from lassokin_ros.core.config import GIVEN, LEARN
from lassokin_ros.core.image.frame_data import FrameData, View
from lassokin_ros.core.learned.camera_finder import CameraFinder
from lassokin_ros.core.learned.epipolar_fit import (
    GIVEN_DEVIATION,
    EpipolarFit,
    Pairs,
    moved_by,
    pair_of,
    relative_size,
    size_of,
    stacked,
)
from lassokin_ros.core.learned.height import SizeCheck
from lassokin_ros.core.observation import CameraPose, has_passed

CHANGED, CONTRADICTS = 0.75, 1.3
"""Sizes, in GIVEN_DEVIATION, of what the last frames suggest beyond what all frames before did: half of it is used in
the covariance, and from which on the cameras are said to contradict each other. A detector's errors cause 0.3 to 0.9, a
camera that was turned by 3 degrees 1.5; see docs/experiments.md."""
LEAST_CHANGE, UNSURE, FARTHEST_OFF = 0.4, 0.5, 2.0
"""The same, below which nothing is added to the covariance, and by how much it may be larger; and m, limit of the
deviation that is added."""
LATELY, FEWEST_JUDGED, FEWEST_KEPT = 6, 10, 10
"""Frames that show at once that a camera was moved; frames before that is judged; and before there is a correction."""


class MovedCameras:
    """Compares the last frames of each camera but the anchor with those before."""

    def __init__(self, fit: EpipolarFit) -> None:
        self._fit = fit
        self.reset()

    def reset(self) -> None:
        """Forget the frames."""
        self._lately: dict[str, deque[Pairs]] = {}
        self._suggested: dict[str, np.ndarray] = {}  # (6,) correction that the last frames suggest, by camera
        self._usual: dict[str, tuple[np.ndarray, int]] = {}  # (6,) mean of those before, and their number
        self.moves: dict[str, np.ndarray] = {}
        """(6,) by how much a camera was moved lately, relative to the anchor, as the last frames suggest, by name."""
        self._anchor = ""

    def add(
        self, name: str, anchor: str, pair: Pairs, due: bool, sized: bool, correction: np.ndarray | None = None
    ) -> None:
        """Use a frame of a camera and of the anchor. due: whether it is time to judge; sized: see `EpipolarFit.solved`.

        correction: (6,) of the pose in use, if poses are corrected.
        """
        frames = self._lately.setdefault(name, deque(maxlen=LATELY))
        frames.append(pair)
        if len(frames) < LATELY or not due:
            return
        start = self._suggested.get(name, np.zeros(6))
        suggested = self._fit.solved(stacked(frames), start, 3 * GIVEN_DEVIATION, sized, steps=2)
        self._suggested[name], self._anchor = suggested, anchor
        if correction is not None:
            self.moves[name] = suggested - correction
            return
        usual, count = self._usual.get(name, (np.zeros(6), 0))
        plausible = relative_size(suggested) < 2.2  # otherwise the first frames do not count as those before
        if count >= FEWEST_JUDGED or not plausible:
            self.moves[name] = suggested - usual
        if plausible and (count < FEWEST_JUDGED or relative_size(self.moves[name]) < CHANGED):
            # The mean of the last ones: a camera that was moved does not change it.
            self._usual[name] = usual + (suggested - usual) / min(count + 1, 25), count + 1

    @property
    def contradicting(self) -> list[str]:
        """Names of the cameras that contradict the anchor since a moment: they were moved, or it was."""
        return [name for name, move in self.moves.items() if relative_size(move) > CONTRADICTS]

    @property
    def in_words(self) -> str:
        """Which camera was moved, in words; empty if none was.

        Of two cameras it cannot be told which one. If several contradict the anchor, it was the anchor.
        """
        names = self.contradicting
        if not names:
            return ""
        largest = max((self.moves[name] for name in names), key=relative_size)
        by = f"about {math.degrees(size_of(largest)[0]):.0f} degrees or {size_of(largest)[1]:.2f} m"
        if len(self.moves) == 1:
            return f"cameras '{self._anchor}' and '{names[0]}' contradict each other: one of them was moved, by {by}"
        moved = names[0] if len(names) == 1 else self._anchor
        return f"camera '{moved}' contradicts the others: it was moved, by {by}"

    def place_covariance(
        self, place: np.ndarray, poses: Mapping[str, CameraPose], moves: Mapping[str, np.ndarray]
    ) -> np.ndarray | None:
        """(3, 3) m^2: how far a place (3,) m is elsewhere with the poses that frames suggest; None if nowhere.

        poses: the given ones, by name; moves: (6,) by how much they are off. It is where the line of sight of the moved
        camera meets the anchor's. Either of both may have been moved, so that the place is off in all directions of the
        plane of the two lines.
        """
        anchor, found = poses.get(self._anchor), np.zeros((3, 3))
        for name, move in moves.items():
            given, size = poses.get(name), relative_size(move)
            if anchor is None or given is None or size < LEAST_CHANGE:
                continue
            share = size**4 / (size**4 + CHANGED**4) * (1 + UNSURE / size)
            seen = moved_by(given, share * move)
            a, b = place - anchor.centre, seen.rotation.T @ (given.rotation @ (place - given.centre))
            normal = np.cross(a, b)
            if not normal.any():
                continue
            s, t, _ = np.linalg.solve(np.stack([a, -b, normal], axis=1), seen.centre - anchor.centre)
            off = 0.5 * (anchor.centre + s * a + seen.centre + t * b) - place
            normal = normal / np.linalg.norm(normal)
            found += min(off @ off, FARTHEST_OFF**2) * (np.eye(3) - np.outer(normal, normal))
        return found if found.any() else None


EXACT = 0.3
"""Size of a correction, in GIVEN_DEVIATION, of which half is used. Those of exact poses are noise, of 0.1 to 0.3; poses
that are 3 cm and 2 degrees off give 0.7 to 1.0."""
FOUND_DEVIATION = np.array([1.0, 1.0, 1.0, 3.0, 3.0, 3.0])
"""rad and m: the same of a pose that was found from the person: it does not count."""
CLEARLY = 2.0
"""Ratio of the median distances from the epipolar lines from which one explanation is said to be right. A turn and a
shift look alike if the person stays in one place: 1 m and 15 degrees at 3.6 m have ratios of up to 2, with a person who
walks 2 m to and fro 8 to 10."""
KEPT_EVERY_S, MOST_KEPT = 0.1, 200
"""s between two frames that are kept; frames that are kept."""
SOLVED_EVERY, CHECKED_EVERY = 5, 20
"""Kept frames between two solutions, if poses are corrected, and if they are only checked."""
MOVED = math.radians(1.5), 0.05
"""rad, m: corrections beyond which a camera is said to have been moved. From exact poses they reach 1 degree, 3 cm."""
FOUND = 0.015
"""Misfit (`EpipolarFit.misfit`) below which a pose that was found from the person is used."""


class Extrinsics:
    """Corrections of the poses of all cameras but one; none if the given poses are neither checked nor corrected."""

    def __init__(self, size: SizeCheck, size_known: bool, mode: str) -> None:
        """size_known: whether the person's height is given. mode: the setting `extrinsics`, see `TrackerConfig`."""
        self._fit, self.size_known = EpipolarFit(size), size_known
        self._mode, self._used = mode, mode == LEARN
        self.lately = MovedCameras(self._fit)
        """Which cameras were moved a moment ago."""
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
        self.lately.reset()

    def adopt(self, other: Extrinsics) -> None:
        """Begin with what was learned about the same cameras, if poses are corrected."""
        if not self._used:
            return
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
        return pose if correction is None else moved_by(pose, correction)

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
        return pose.known and not pose.is_at(self.found.get(pose.name, pose))

    def find(self, name: str, stamp: float, views: tuple[View, View], joints: tuple[np.ndarray, np.ndarray]) -> None:
        """Use a frame of a camera without a pose, see `CameraFinder.add`. The pose is used if the keypoints fit it."""
        finder = self._finders.setdefault(name, CameraFinder(KEPT_EVERY_S, MOST_KEPT))
        if not finder.add(stamp, views, joints):
            return
        pose = finder.pose(name)
        frames = _entries(finder, pose)
        if len(frames) < FEWEST_KEPT:
            return
        pose = moved_by(pose, self._fit.solved(stacked(frames), np.zeros(6), FOUND_DEVIATION, sized=True, steps=15))
        frames = _entries(finder, pose)
        if self._fit.misfit(stacked(frames), self.size_known) < FOUND:
            self.found[name], self._frames[name] = pose, frames
            del self._finders[name]

    def learned(self, pose: CameraPose) -> CameraPose:
        """Return a given pose with what was learned about its camera, also if it is only checked."""
        solution = self._solutions.get(pose.name)
        return pose if solution is None else moved_by(pose, solution)

    def place_covariance(self, place: np.ndarray) -> np.ndarray | None:
        """See `MovedCameras.place_covariance`. Poses that are off, and not corrected, count as well."""
        moves, contradicting = dict(self.lately.moves), self.lately.contradicting
        for name, off in self._solutions.items() if not self._used else ():
            if name not in contradicting and self.moved(name) is not None:
                moves[name] = off + moves.get(name, np.zeros(6))
        return self.lately.place_covariance(place, self._given, moves)

    def moved(self, name: str) -> tuple[float, float] | None:
        """Return by how much a camera is elsewhere than given, rad and m; None if it is where it should be."""
        solution = self.solution(name)
        return solution if solution is not None and (solution[0] > MOVED[0] or solution[1] > MOVED[1]) else None

    def solution(self, name: str) -> tuple[float, float] | None:
        """Return by how much a camera's pose differs from the given one, rad and m; None before it is known."""
        found = self._solutions.get(name)
        return None if found is None else size_of(found)

    def in_words(self, name: str) -> str:
        """Return by how much the given pose of a camera is off; empty if it is not.

        Of two cameras it cannot be told whose pose it is.
        """
        moved = self.moved(name)
        if moved is None or name in self.found:
            return ""
        if self._used:
            off, done = f"{math.degrees(moved[0]):.1f} degrees and {moved[1]:.2f} m", ""
        else:
            off, done = f"about {self._explained(name)}", "not "
        done = f"this is {done}corrected (see extrinsics)"
        which = " or ".join(f"'{one}'" for one in (self._given if len(self._given) == 2 else [name]))
        return f"camera {which}: the keypoints suggest that its pose is off by {off}; {done}"

    def _explained(self, name: str) -> str:
        """Return by how much a camera is turned or shifted, in words: both values if it cannot be told which."""
        (turned, turn), (shifted, shift), (moved, both) = self._explanations[name]
        degrees, metres = f"{math.degrees(size_of(turned)[0]):.0f} degrees", f"{size_of(shifted)[1]:.1f} m"
        if min(turn, shift) > CLEARLY * both:
            angle, distance = size_of(moved)
            return f"{math.degrees(angle):.0f} degrees and {distance:.1f} m"
        if turn > CLEARLY * shift:
            return metres
        return degrees if shift > CLEARLY * turn else f"{degrees} or {metres}"

    def update(self, stamp: float, frame: FrameData) -> None:
        """Use a frame with the views of all cameras. stamp: s."""
        if self._mode == GIVEN or not has_passed(stamp - self._newest, KEPT_EVERY_S):
            return
        self._newest, first = stamp, self._anchor_of(frame)
        if first is None or first.camera.name not in self._given:
            return  # the camera whose pose is right has not been seen
        others = [view for view in frame.views if view is not first and view.camera.name in self._given]
        anchor = self._given[first.camera.name]
        seen = {view.camera.name: pair_of(first, view, self._given[view.camera.name], anchor) for view in others}
        self.frame_count += any(seen.values())
        due = self.frame_count % (SOLVED_EVERY if self._used else CHECKED_EVERY) == 0
        for name, pair in seen.items():
            if pair is None:
                continue
            if name not in self.found:
                in_use = self.corrections.get(name, np.zeros(6)) if self._used else None
                self.lately.add(name, first.camera.name, pair, self.frame_count % 2 == 0, self.size_known, in_use)
            frames = self._frames.setdefault(name, deque(maxlen=MOST_KEPT))
            frames.append(pair)
            if due and len(frames) >= FEWEST_KEPT:
                pairs, before = stacked(frames), self._solutions.get(name, np.zeros(6))
                found = name in self.found
                deviation = FOUND_DEVIATION if found else GIVEN_DEVIATION
                self._solutions[name] = self._fit.solved(pairs, before, deviation, found or self.size_known)
                if not self._used and self.moved(name) is not None:
                    self._explain(stacked(list(frames)[::4]), name)  # 15 ms
        for name, solution in self._solutions.items():
            before = self.corrections.get(name, np.zeros(6))
            size = relative_size(solution) ** 4
            wanted = solution if name in self.found else size / (size + EXACT**4) * solution
            self.corrections[name] = before + 0.1 * (wanted - before)  # so that the body does not jump

    def _anchor_of(self, frame: FrameData) -> View | None:
        """Return the view of the camera whose pose is not corrected: the chosen one, None if it has none; without a
        choice the one in whose frame the skeleton is, or the first.
        """
        views = frame.views
        if self.anchor is None:
            given = [self._given.get(view.camera.name) for view in views]
            return next((view for view, pose in zip(views, given) if pose and pose.is_identity), views[0])
        return next((view for view in views if view.camera.name == self.anchor), None)

    def _explain(self, pairs: Pairs, name: str) -> None:
        """Fit a turn, a shift, and both, without regard to the given pose."""
        before, found = self._explanations.get(name, 3 * [(np.zeros(6), 0.0)]), []
        fixed = np.full(3, 1e-6)
        turned, shifted = np.append(FOUND_DEVIATION[:3], fixed), np.append(fixed, FOUND_DEVIATION[3:])
        for (start, _), deviation in zip(before, (turned, shifted, FOUND_DEVIATION)):
            solution = self._fit.solved(pairs, start, deviation, self.size_known)
            distances, *_ = self._fit.residuals(pairs, solution)
            found.append((solution, float(np.median(np.abs(distances[pairs.weights > 0])))))
        self._explanations[name] = found


def _entries(finder: CameraFinder, pose: CameraPose) -> deque[Pairs]:
    """Frames of a camera with a found pose, as `Extrinsics` keeps them."""
    pairs = (pair_of(placed, unplaced, pose, placed.camera) for placed, unplaced in finder.views)
    return deque(filter(None, pairs), maxlen=MOST_KEPT)
