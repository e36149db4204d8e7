"""The scenes of the figures of docs/tuning.md: synthetic motion, a detector with known errors, and the tracker."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.accuracy_run.metrics import mpjpe
from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.observation import Observation, Status
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.demo.synthetic import WEBCAM, Detector, detections, exact_pixels, motion
from lassokin_ros.pipeline.seen import Image, people_in

HEIGHT, LANDMARKS = 1.75, 17
NO_GAPS = Detector(noise_px=3.0, outliers=0.0, gaps_per_second=0.0)


@dataclass(frozen=True, eq=False)
class Scene:
    """times: (f,) s; joints: (f, 24, 3) m, true, camera frame; pixels: (f, 17, 2) px; confidence: (f, 17)."""

    times: np.ndarray
    joints: np.ndarray
    pixels: np.ndarray
    confidence: np.ndarray

    @property
    def rate(self) -> float:
        """Hz."""
        return 1 / float(self.times[1] - self.times[0])


@dataclass(frozen=True, eq=False)
class Run:
    """The tracker's results for a scene, NaN where it published nothing.

    joints: (f, 24, 3) m; moving: (f,) degrees of freedom that move; lost: (f,) bool; error_mm: (f,).
    """

    joints: np.ndarray
    moving: np.ndarray
    lost: np.ndarray
    error_mm: np.ndarray


def scene(seconds: float, rate: float, detector: Detector = NO_GAPS, seed: int = 0, start: float = 0.0) -> Scene:
    """The synthetic person, seen by the webcam and a detector."""
    tracker = Tracker(TrackerConfig(height=HEIGHT))
    times = start + np.arange(round(seconds * rate)) / rate
    states = motion(tracker.skeleton, times)
    pixels, confidence = detections(exact_pixels(tracker.kinematics, states), rate, seed, detector)
    return Scene(times - start, tracker.kinematics.pose(states).positions, pixels, confidence)


def run(seen: Scene, **settings: Any) -> Run:
    """Track a scene with these settings."""
    tracker = Tracker(TrackerConfig(**{"height": HEIGHT, **settings}))
    lens, frames = WEBCAM.lens, len(seen.times)
    joints, moving = np.full(seen.joints.shape, np.nan), np.full(frames, np.nan)
    lost = np.zeros(frames, dtype=bool)
    for row, (stamp, pixels, confidence) in enumerate(zip(seen.times, seen.pixels, seen.confidence)):
        points = np.where(confidence[:, None] > 0, lens.normalise(pixels), np.nan)
        estimate = tracker.track(Observation(stamp, points, confidence, lens.focal))
        lost[row] = estimate.status is Status.LOST
        if estimate.accepted:
            joints[row] = estimate.pose.positions
            moving[row] = np.count_nonzero(estimate.increment.omega)
    error = np.full(frames, np.nan)
    out = np.isfinite(moving)
    error[out] = mpjpe(joints[out], seen.joints[out], joints[out, 0], seen.joints[out, 0])
    return Run(joints, moving, lost, error)


def with_poor_points(clean: Scene, seed: int = 3) -> Scene:
    """A detector that guesses a hidden arm and leg for 2 s of each 4 s, with large errors and low confidence.

    Their confidence is 0.05 to 0.35; that of the others 0.5 and more.
    """
    random = np.random.default_rng(seed)
    pixels, confidence = clean.pixels.copy(), np.clip(clean.confidence, 0.5, 1.0)
    hidden = (clean.times % 4.0) < 2.0
    for landmark in (7, 9, 13, 15):
        wander = np.cumsum(random.normal(size=(len(clean.times), 2)) * 5.0, axis=0)
        pixels[hidden, landmark] += (wander + random.normal(size=2) * 50.0)[hidden]
        confidence[hidden, landmark] = random.uniform(0.05, 0.35, hidden.sum())
    return Scene(clean.times, clean.joints, pixels, confidence)


def with_gap(clean: Scene, start: float, end: float) -> Scene:
    """Nothing is detected from start to end, s."""
    confidence = clean.confidence.copy()
    confidence[(clean.times >= start) & (clean.times < end)] = 0.0
    return Scene(clean.times, clean.joints, clean.pixels, confidence)


def people_crossing(seconds: float = 4.0, rate: float = 30.0) -> tuple[Sequence[Scene], np.ndarray]:
    """Two people who walk past each other, and (f, 2) the detector's numbers for them, which change on the way."""
    tracker = Tracker(TrackerConfig(height=HEIGHT))
    times = np.arange(round(seconds * rate)) / rate
    course = np.linspace(-1.0, 1.0, len(times))
    scenes = []
    for x, z, phase, seed in ((course, 3.2, 0.0, 1), (-1.3 * course, 4.4, 5.0, 2)):
        states = motion(tracker.skeleton, times + phase)
        places = states.translation.copy()
        places[:, 0], places[:, 2] = x, z
        states = BodyState(states.rotations, places)
        pixels, confidence = detections(exact_pixels(tracker.kinematics, states), rate, seed, NO_GAPS)
        scenes.append(Scene(times, tracker.kinematics.pose(states).positions, pixels, confidence))
    numbers = np.tile([0, 1], (len(times), 1))
    numbers[times > 0.5 * seconds] = [1, 0]
    return scenes, numbers


def follow_people(scenes: Sequence[Scene], numbers: np.ndarray, lasting: bool) -> dict[str, np.ndarray]:
    """Id -> (f,) m, x of the pelvis. lasting: use the detector's numbers, wherever they are (`person_ids: lasting`)."""
    from collections import Counter

    from lassokin_ros.pipeline.people.people_tracker import PeopleTracker
    from lassokin_ros.pipeline.people.roster import Roster
    from lassokin_ros.pipeline.people.tracked_person import TrackedPerson
    from lassokin_ros.pipeline.settings import NodeSettings
    from msg_adapters.keypoints import Keypoints

    lens = WEBCAM.lens
    bodies = [TrackedPerson(TrackerConfig(height=HEIGHT)) for _ in range(4)]
    settings = NodeSettings(person_ids="lasting") if lasting else NodeSettings()
    people = PeopleTracker(Roster(bodies, Counter(), settings))
    paths: dict[str, np.ndarray] = {}
    for row, stamp in enumerate(scenes[0].times):
        xy = np.concatenate([scene.pixels[row] for scene in scenes])
        scores = np.concatenate([scene.confidence[row] for scene in scenes])
        count = len(xy) // len(scenes)
        stamp_ns = 1 + round(1e9 * stamp)
        ids, persons = np.tile(np.arange(count), len(scenes)), np.repeat(numbers[row], count).astype(int)
        keypoints = Keypoints(stamp_ns, "camera", ids, xy, scores, persons)
        detections = people_in(keypoints, count, lens, bodies[0].tracker.config)
        image = Image(detections, stamp_ns, "camera", lens, lasting=lasting)
        for frame in people.update([image], "camera"):
            path = paths.setdefault(frame.person, np.full(len(scenes[0].times), np.nan))
            path[row] = frame.estimate.pose.positions[0, 0]
    return paths


def averages(
    scenes: Sequence[Scene], name: str, values: Sequence[float], *measures: Callable[[Run, Scene], float]
) -> np.ndarray:
    """(measures, values): means over the scenes, each tracked with every value of the parameter."""
    result = np.zeros((len(measures), len(values), len(scenes)))
    for column, value in enumerate(values):
        for layer, seen in enumerate(scenes):
            tracked = run(seen, **{name: value})
            result[:, column, layer] = [measure(tracked, seen) for measure in measures]
    return result.mean(axis=2)


def error(tracked: Run, _: Scene) -> float:
    """Mean over the frames, mm; NaN if there is none."""
    return float(np.nanmean(tracked.error_mm)) if np.isfinite(tracked.error_mm).any() else float("nan")


def support(tracked: Run, _: Scene) -> float:
    """Mean number of degrees of freedom that move in a frame."""
    return float(np.nanmean(tracked.moving))


def given(tracked: Run, _: Scene) -> float:
    """Share of the frames with an output, %."""
    return 100 * float(np.mean(np.isfinite(tracked.error_mm)))


def far_off(tracked: Run, _: Scene) -> float:
    """Share of the frames with an error above 100 mm, %."""
    return 100 * float(np.mean(tracked.error_mm > 100))


def shake(tracked: Run, seen: Scene) -> float:
    """Mean size of the joints' second difference, m/s^2."""
    return float(np.nanmean(np.linalg.norm(np.diff(tracked.joints, 2, axis=0), axis=-1)) * seen.rate**2)
