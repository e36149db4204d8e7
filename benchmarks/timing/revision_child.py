"""One revision's side of benchmarks/against.py: a process that times frames when it is asked to.

    python revision_child.py FRAMES.npz BODIES        (PYTHONPATH and the working folder: the revision's root)

It reads one request per line, {"figure": ..., "first": i, "count": n}, and answers with one line of JSON: a list of CPU
times in seconds for each thing that the request times, and the last estimate's joints. It imports nothing of the
revision that runs against.py: only what both interfaces, today's and that of 842c7c2, have in common.
"""

from __future__ import annotations

import json
import os
import sys
import time
from contextlib import ExitStack
from typing import Any, Callable

import numpy as np

try:
    from lassokin_ros import Observation, Tracker, TrackerConfig

    track_batch = Tracker.track_batch
except ImportError:  # the interface of 842c7c2
    from lassokin_ros.core.config import TrackerConfig
    from lassokin_ros.core.estimate import Observation
    from lassokin_ros.core.tracker import Tracker

    track_batch = Tracker.track_together

HEIGHT, NOISE_PX = 1.75, 2.0
QUARTER_TURN = np.array([[0.0, 1.0], [-1.0, 0.0]])
Answer = dict[str, Any]


class People:
    """Trackers of one or several people, who are followed frame by frame."""

    def __init__(self, frames: Any, points: np.ndarray, settings: dict[str, Any]) -> None:
        """points: (people, f, landmarks, 2) normalised."""
        self._points, self._starts = points, set(frames["starts"].tolist())
        self._stamps, self._focal = frames["stamps"], float(frames["focal"])
        config = TrackerConfig(height=HEIGHT, noise_px=NOISE_PX, **settings)
        self.trackers = [Tracker(config) for _ in points]

    def observation(self, person: int, frame: int) -> Any:
        """What a person's detector found."""
        points = self._points[person, frame]
        return Observation(float(self._stamps[frame]), points, np.ones(len(points)), self._focal)

    def steps(self, first: int, count: int) -> Answer:
        """Track `count` frames; those in which a clip starts are not timed."""
        taken = []
        for frame in range(first, first + count):
            if frame in self._starts:
                for tracker in self.trackers:
                    tracker.reset()
            observations = [self.observation(person, frame) for person in range(len(self.trackers))]
            start = time.thread_time()
            if len(observations) == 1:
                estimates = [self.trackers[0].track(observations[0])]
            else:
                estimates = track_batch(self.trackers, observations)
            end = time.thread_time()
            if not any(estimate.initialised for estimate in estimates):
                taken.append(end - start)
        return {"seconds": [taken], "joints": _joints(estimates[0])}


class FirstFrames:
    """A tracker that starts anew in every frame; with the image turned by a quarter the person lies."""

    def __init__(self, people: People, turn: np.ndarray) -> None:
        self._people, self._turn = people, turn

    def steps(self, first: int, count: int) -> Answer:
        """Initialise from each of `count` frames."""
        taken, tracker = [], self._people.trackers[0]
        for frame in range(first, first + count):
            seen = self._people.observation(0, frame)
            observation = Observation(seen.stamp, seen.points @ self._turn, seen.confidence, seen.focal)
            tracker.reset()
            start = time.thread_time()
            estimate = tracker.track(observation)
            taken.append(time.thread_time() - start)
        return {"seconds": [taken], "joints": _joints(estimate)}


class Callbacks:
    """The node's callback with nobody subscribed and with all outputs, by the revision's own benchmarks module."""

    def __init__(self, people: People, frames: Any, leave: ExitStack) -> None:
        try:
            from benchmarks.timing import callback
        except ImportError:  # the place in 842c7c2
            from benchmarks import callback
        from msg_adapters.backends import RclpyBackend
        from msg_adapters.inputs import camera_info, point_cloud

        self._callback, self._people, self._focal = callback, people, float(frames["focal"])
        self._backend, self._point_cloud = RclpyBackend(), point_cloud
        nodes = leave.enter_context(callback._nodes())
        info = camera_info(self._backend, 0, callback.FRAME_ID, callback.K, np.zeros(0), callback.SIZE)
        for node in nodes:
            node._camera_info.take(info)
        #: (node, clock on its tracker's step) without subscriptions, and with one on every output.
        self._nodes = [(node, _cpu_clock(node, callback)) for node in (nodes[0], nodes[-1])]

    def steps(self, first: int, count: int) -> Answer:
        """seconds: for either audience the whole callback, then what it takes beyond the tracker's step."""
        seconds: list[list[float]] = [[], [], [], []]
        for frame in range(first, first + count):
            seen = self._people.observation(0, frame)
            pixels = seen.points * self._focal + self._callback.CENTRE
            stamp = round((1.0 + seen.stamp) * 1e9)
            for number, (node, clock) in enumerate(self._nodes):
                message = self._point_cloud(self._backend, stamp, self._callback.FRAME_ID, pixels, seen.confidence)
                clock.clear()
                start = time.thread_time()
                node.work_on(message)
                whole = time.thread_time() - start
                if frame > 0:
                    seconds[number].append(whole)
                    seconds[2 + number].append(whole - sum(clock))
        return {"seconds": seconds, "joints": None}


def _cpu_clock(node: Any, callback: Any) -> list[float]:
    """A list to which each step of the node's tracker appends its CPU time."""
    run: Callable[..., Any] = getattr(callback, "run_single", None) or callback.alone
    times: list[float] = []
    tracker = node._pipeline.tracker
    original = tracker.steps

    def steps(observation: Any) -> Any:
        start = time.thread_time()
        estimate = run(original(observation))
        times.append(time.thread_time() - start)
        return estimate
        yield  # a generator, as the tracker's own

    tracker.steps = steps
    return times


def _joints(estimate: Any) -> list[list[float]] | None:
    """(n, 3) m, None for a rejected frame."""
    return None if estimate.pose is None else estimate.pose.positions.tolist()


def main() -> None:
    """Answer requests until the input ends."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # whatever else is printed must not stand between the answers
    frames = np.load(sys.argv[1])
    bodies = sys.argv[2]
    coco, hands = frames["coco"], frames["hands"]
    hand_settings = {"skeleton": f"{bodies}/hands55.yaml", "landmarks": f"{bodies}/body25_hands.yaml"}
    makers: dict[str, Callable[[], Any]] = {
        "step": lambda: People(frames, coco[:1], {}),
        "people": lambda: People(frames, coco, {}),
        "joints": lambda: People(frames, hands, hand_settings),
        "upright": lambda: FirstFrames(People(frames, coco[:1], {}), np.eye(2)),
        "lying": lambda: FirstFrames(People(frames, coco[:1], {}), QUARTER_TURN),
        "callback": lambda: Callbacks(People(frames, coco[:1], {}), frames, leave),
    }
    made: dict[str, Any] = {}
    with ExitStack() as leave:
        for line in sys.stdin:
            request = json.loads(line)
            figure = request["figure"]
            if figure not in made:
                made[figure] = makers[figure]()
            print(json.dumps(made[figure].steps(request["first"], request["count"])), file=answers, flush=True)


if __name__ == "__main__":
    main()
