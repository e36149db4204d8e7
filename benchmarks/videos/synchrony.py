"""Offsets between cameras, and faults of their set-up, found from one person's keypoints without any other knowledge.

    python benchmarks/videos/synchrony.py [--case offset,occlusion,lost,drift,two,set-up] [--validation-people]

Motion capture, seen by two simulated cameras (set-up: two to four) with a detector's errors, whose clocks differ by up
to 5 s. Cases: `offset`; `occlusion`, the second camera sees nobody in a third of the time, and no legs in another
third; `lost`, 15 consecutive images of the second camera are lost and its stamps go on as if they were not; `drift`,
its clock is 1,000 ppm fast; `two`, another person is in view of both cameras, too. `stand` are people who move little:
there, what counts is whether a wrong offset is said to be sure. `set-up`: the share of the faults that is named.

`sure` is the share of the runs with an offset that is said to be sure. `wrong` are those off by more than a frame, and
`inside` those within 1.96 stated deviations, among the sure ones.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from benchmarks.common.report import Record, exit_code, table, write_json  # isort: skip  (threads, before numpy)
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from benchmarks.accuracy_run.people import chosen_clips
from benchmarks.common import option_types
from benchmarks.data.mocap import clip_height, clip_skeleton, landmark_positions, load_clip
from benchmarks.data.rig import DISTANCE, Z_UP, moved
from lassokin_ros.core.body.kinematics import Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.observation import CameraPose
from lassokin_ros.core.rig.setup import UNITS, Explanation, SetUpCheck
from lassokin_ros.detector.backend import Detected
from lassokin_ros.video.people import Found
from lassokin_ros.video.synchrony import synchronised

FPS, LARGEST_OFFSET_S, LOST, WANDERS_S = 30.0, 5.0, 15, 0.5
CASES = ("offset", "occlusion", "lost", "drift", "two", "set-up")
FAULTS = ("none", "3 cm, 2 degrees", "all inverted", "one inverted", "exchanged", "mm", "cm", "z down", "y up",
          "one wrong")  # fmt: skip
COLUMNS = {"case": "<", "group": "<", "runs": "d", "sure_percent": ".0f", "median_ms": ".1f", "wrong_percent": ".1f",
           "inside_percent": ".0f"}  # fmt: skip
SETUP_COLUMNS = {"fault": "<", "runs": "d", "named_percent": ".0f", "alarms_percent": ".0f"}
STILL = 0.15
"""m/s: mean speed of the landmarks below which a person stands."""


class Person:
    """A person's landmarks at any time, in a frame with z up. height: m."""

    def __init__(self, file: Path) -> None:
        clip = load_clip(file)
        own = clip_skeleton(clip, generic=False)
        self.layout = Layout.load("coco17", own)
        marks = landmark_positions(clip, self.layout, own) @ Z_UP.T
        marks -= 0.5 * (marks.mean(1).min(0) + marks.mean(1).max(0))
        times = np.arange(len(marks)) / clip.fps
        self.at, self.end, self.height = CubicSpline(times, marks), float(times[-1]), clip_height(clip)
        self.kind = "stand" if np.linalg.norm(np.diff(marks, axis=0), axis=-1).mean() * clip.fps < STILL else "move"

    @property
    def rest(self) -> np.ndarray:
        """(l, 3) m: the landmarks of the built-in skeleton of this height at rest."""
        kinematics = Kinematics(Skeleton.load("anthropometric", self.height), self.layout)
        return kinematics.skeleton.rest_positions[self.layout.joints] + self.layout.offsets


def cameras_around(count: int, distance: float, random: np.random.Generator) -> list[CameraPose]:
    """Cameras 40 to 140 degrees apart, at heights of 0.5 to 2.5 m, that look at the middle."""
    angle, poses = random.uniform(-np.pi, np.pi), []
    for number in range(count):
        centre = np.array([distance * np.sin(angle), -distance * np.cos(angle), random.uniform(-0.5, 1.5)])
        forward = -centre / np.linalg.norm(centre)
        right = np.cross(forward, [0, 0, 1.0])
        right /= np.linalg.norm(right)
        R = np.stack([right, np.cross(forward, right), forward])
        poses.append(CameraPose(f"camera{number}", R, -R @ centre))
        angle += np.radians(random.uniform(40, 140)) if count == 2 else 2 * np.pi / count + random.uniform(-0.3, 0.3)
    return poses


def seen(marks: np.ndarray, pose: CameraPose, focal: float, random: np.random.Generator) -> np.ndarray:
    """(f, l, 2) px with a detector's errors: white, lasting and constant ones."""
    pixels = project(pose.into_camera(marks)) * focal
    kept = np.exp(-1 / (FPS * WANDERS_S))
    wander = 2.5 * random.normal(size=pixels.shape)
    wander[1:] *= np.sqrt(1 - kept**2)
    pixels += lfilter([1.0], [1.0, -kept], wander, axis=0) + 2.5 * random.normal(size=pixels.shape[1:])
    return np.asarray(pixels + 1.5 * random.normal(size=pixels.shape))


def offset_run(case: str, person: Person, other: Person, seconds: float, random: np.random.Generator) -> Record:
    """One draw: the offset that is found, and the true one. The second camera begins up to 1 s later or earlier."""
    length = min(seconds, person.end - 1.0)
    begin = random.uniform(0, person.end - 1.0 - length)
    true = random.uniform(-LARGEST_OFFSET_S, LARGEST_OFFSET_S)
    poses = cameras_around(2, DISTANCE + random.uniform(0, 2), random)
    people = [person, other][: 1 + (case == "two")]
    images: list[list[Found]] = []
    for number, pose in enumerate(poses):
        times = random.uniform(0, 1) + np.arange(0, length, 1 / FPS)
        stamps = true * number + times * (1.001 if case == "drift" and number else 1.0)
        focal, first = random.uniform(1000, 1400), int(random.integers(len(times) // 3, 2 * len(times) // 3))
        rows = []
        for index, one in enumerate(people):
            marks = one.at(np.clip(begin + times if one is person else times, 0, one.end)) + [1.2 * index, 0, 0]
            pixels, known = seen(marks, pose, focal, random), random.uniform(size=(len(times), 17)) > 0.03
            if case == "occlusion" and number:
                third = np.minimum(3 * np.arange(len(times)) // len(times), 2)
                known[third == 1] = False
                known[np.ix_(third == 2, np.arange(11, 17))] = False
            rows.append([Detected(p + 960, k.astype(float)) for p, k in zip(pixels, known)])
        found = [(float(stamp), list(one)) for stamp, one in zip(stamps, zip(*rows))]
        if case == "lost" and number:
            kept = found[:first] + found[first + LOST :]
            found = [(stamp, one) for (stamp, _), (_, one) in zip(found, kept)]
        images.append(found)
    (_, course), (remark,) = synchronised(["a", "b"], images, None)
    sure = "not determinable" not in remark
    at = images[1][len(images[1]) // 4][0]
    error = float(course.at(np.array([at]))[0]) - true
    if case == "drift":
        error -= 0.001 * (at - true)
    said = re.search(r"(?:- |to )(\d+) ms", remark)
    return {"case": case, "group": person.kind, "sure": sure, "error_s": error,
            "deviation_s": int(said[1]) / 1000 if said else 0.01,
            "lost": bool(course.lost)}  # fmt: skip


def set_up_run(fault: str, person: Person, random: np.random.Generator) -> Record:
    """One draw of a set-up with a fault: whether it is named, and whether there is an alarm."""
    count = int(random.choice([2, 3, 4])) if fault != "one wrong" else int(random.choice([3, 4]))
    length = min(6.0, person.end)
    times = random.uniform(0, person.end - length) + np.arange(0, length, 0.1)
    poses = cameras_around(count, DISTANCE + random.uniform(0, 2), random)
    focals = random.uniform(1000, 1400, count)
    pixels = [seen(person.at(times), pose, focal, random) for pose, focal in zip(poses, focals)]
    known = [random.uniform(size=p.shape[:2]) > 0.03 for p in pixels]
    everything, wrong, unit, axis = tuple(range(count)), None, "m", "+z"
    want, given = Explanation(everything), [(pose.rotation, pose.translation) for pose in poses]
    one = int(random.integers(count))
    if fault == "3 cm, 2 degrees":
        given[1:] = [_pose(moved(pose, 0.03, np.radians(2), random)) for pose in poses[1:]]
    elif fault == "all inverted":
        given, want = [_pose(pose.inverse) for pose in poses], Explanation(everything, frozenset(everything))
    elif fault == "one inverted":
        given[one], want = _pose(poses[one].inverse), Explanation(everything, frozenset([one]))
    elif fault == "exchanged":
        order, other = list(everything), (one + 1) % count
        order[one], order[other] = other, one
        pixels, known, want = [pixels[i] for i in order], [known[i] for i in order], Explanation(tuple(order))
    elif fault in UNITS:
        unit, given = fault, [(R, UNITS[fault] * t) for R, t in given]
    elif fault in ("z down", "y up"):
        turn, axis = (np.diag([1.0, -1, -1]), "-z") if fault == "z down" else (Z_UP.T, "+y")
        given = [(R @ turn.T, t) for R, t in given]
    elif fault == "one wrong":
        wrong = one
        given[one] = _pose(moved(poses[one], 0.6, np.radians(random.uniform(20, 60)), random))
    lenses = [partial(np.multiply, 1 / focal) for focal in focals]
    found = SetUpCheck(pixels, known, lenses, given, person.layout.names, person.rest).result()
    assert found is not None
    named = found.found == want and found.unit == unit and (found.axis == axis or bool(want.inverted))
    alarm = found.found is None or not found.found.is_given or found.unit != "m"
    cost = found.costs[Explanation(everything)]
    return {"fault": fault, "named": named if wrong is None else found.wrong == wrong, "alarm": alarm, "cost": cost}


def _pose(pose: CameraPose) -> tuple[np.ndarray, np.ndarray]:
    return pose.rotation, pose.translation


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line."""
    options = parser().parse_args(arguments)
    people = [person for person in map(Person, chosen_clips(options)) if person.end > options.seconds + 1.5]
    if len(people) < 2:
        raise SystemExit(f"{len(people)} clips of {options.seconds:g} s or more; expected two or more")
    records: list[Record] = []
    for case in options.case:
        for number in range(options.runs):
            random = np.random.default_rng([options.seed, number, CASES.index(case)])
            person, other = (people[(number * 7 + step) % len(people)] for step in (0, 3))
            if case == "set-up":
                records += [{"case": case, **set_up_run(fault, person, random)} for fault in FAULTS]
            else:
                records.append(offset_run(case, person, other, options.seconds, random))
    if rows := _offset_rows(records):
        print(table(rows, COLUMNS))
    if rows := _set_up_rows(records):
        print(table(rows, SETUP_COLUMNS))
    write_json(options.json, records)
    return 0


def _offset_rows(records: Sequence[Record]) -> list[Record]:
    rows = []
    for case in CASES[:-1]:
        for group in ("move", "stand"):
            own = [record for record in records if record["case"] == case and record["group"] == group]
            sure = [record for record in own if record["sure"]]
            error = np.abs([record["error_s"] for record in sure])
            deviation = np.array([record["deviation_s"] for record in sure])
            row: Record = {"case": case, "group": group, "runs": len(own)}
            if own:
                row["sure_percent"] = 100 * len(sure) / len(own)
                rows.append(row)
            if sure:
                row |= {"median_ms": 1000 * float(np.median(error)),
                        "wrong_percent": 100 * float(np.mean(error > 1 / FPS)),
                        "inside_percent": 100 * float(np.mean(error < 1.96 * deviation))}  # fmt: skip
    return rows


def _set_up_rows(records: Sequence[Record]) -> list[Record]:
    rows = []
    for fault in FAULTS:
        own = [record for record in records if record.get("fault") == fault]
        if own:
            figures = {f"{key}_percent": 100 * float(np.mean([record[of] for record in own]))
                       for key, of in (("named", "named"), ("alarms", "alarm"))}  # fmt: skip
            rows.append({"fault": fault, "runs": len(own), **figures})
    return rows


def parser() -> argparse.ArgumentParser:
    """The command line's options."""
    result = option_types.command_line(__doc__, "data", "validation-people", "seed")
    add = result.add_argument
    add("--case", type=option_types.some_of(CASES), default=list(CASES), help=f"some of {', '.join(CASES)}")
    add("--runs", type=option_types.count, default=60, help="draws per case (60)")
    add("--seconds", type=option_types.positive, default=5.0, help="s that both cameras see (5)")
    return result


if __name__ == "__main__":
    sys.exit(exit_code(main))
