"""A humanoid that imitates people of motion capture: errors, jerk, lag, feet, limits, time of a tick.

python benchmarks/robots/imitation.py --data DIR [--robots g1,h1] [--clips 02_01,49_18] [--free] [--seconds 12]

DIR has the folders mocap and robots (default: LASSOKIN_DATA). Each clip is seen by one simulated camera with a
detector's errors at 30 Hz, tracked live with the height alone given, and imitated at 100 Hz.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import numpy as np
import pinocchio as pin

from benchmarks.accuracy_run.experiment import Job, Scene, scene_of
from benchmarks.data.mocap import EVALUATED
from benchmarks.data.simulated_camera import Condition
from lassokin_ros import joints
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.robot.clearance import Clearance
from lassokin_ros.robot.imitation import Imitation
from lassokin_ros.robot.model import RobotModel
from lassokin_ros.robot.person import ANKLES, Person
from lassokin_ros.robot.robot_file import CHAINS, SIDES, load_robot

FPS, RATE = 30.0, 100.0
CONDITION = Condition(noise_px=1.5, wander_px=2.5, offset_px=2.5, fps=FPS)
URDFS = {"g1": "g1_29dof.urdf", "h1": "h1.urdf", "h1_2": "h1_2_handless.urdf", "talos": "talos.urdf"}
CLIPS = "02_01,02_05,49_18,131_03,13_29,exp_traffic_1,gs_charleston1"
"""Walk, boxing, balance on one leg, start and stop, exercises, a policeman, a fast dance. No constant but
clearance.LEAST was chosen on them, but on mx_05_10, mx_14_08, pa_60_05, cy_02_08, 14_20 and mx_49_12."""
SCORED_FROM_S = 2.5
"""s: earlier the speeds are limited further."""
COLUMNS = (
    *("tick ms", "wrist mm", "elbow deg", "knee deg", "jerk", "lag ms", "skate mm/s", "sole mm", "contact %"),
    *("mass mm", "over", "unsolved"),
)


@dataclass(frozen=True, eq=False)
class Run:
    """A robot's ticks. positions, flexions: (t, k) rad. ankles: (t, 2, 3) m. standing: (t, 2). wrist: (t, 2) m.

    touching: (t,) bool, capsules overlap. mass: (t,) m, of the centre of mass from the line between the ankles that
    stand; NaN if none does. over: rad beyond limits.
    """

    positions: np.ndarray
    flexions: np.ndarray
    ankles: np.ndarray
    standing: np.ndarray
    wrist: np.ndarray
    touching: np.ndarray
    mass: np.ndarray
    over: float
    unsolved: int


def tracked(scene: Scene, seconds: float) -> list[Person | None]:
    """Return the person in each image, None where nobody is tracked."""
    tracker, people = Tracker(scene.config, scene.skeleton), []
    for observation in scene.observations[: round(seconds * FPS)]:
        estimate = tracker.track(observation)
        if not estimate.accepted:
            people.append(None)
            continue
        places = estimate.pose.positions
        people.append(Person(places, np.ones(len(places), dtype=bool), estimate.up, estimate.contacts[ANKLES]))
    return people


def flexions(places: dict[str, np.ndarray]) -> list[float]:
    """Return the angles, rad, of elbows and knees: 0 for a straight limb. places: (3,) m by name."""
    result = []
    for names in CHAINS.values():
        for side in SIDES:
            a, b, c = (places[f"{side}_{name}"] for name in names)
            result.append(float(np.arccos(np.clip(_unit(b - a) @ _unit(c - b), -1, 1))))
    return result


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector)


def tick_time(people: Sequence[Person | None], robot: Imitation) -> float:
    """Return the processor time, s, of a tick with its share of the images."""
    ticks, start = 0, time.process_time()
    for image, view in enumerate(people):
        if view is not None:
            robot.see(view, 1 / FPS)
        for _ in range(3 + (image % 3 == 0)):
            robot.step()
            ticks += 1
    return (time.process_time() - start) / ticks


def imitated(model: RobotModel, people: Sequence[Person | None]) -> Run:
    """Return the ticks of a robot that sees the people."""
    robot, image, clearance = Imitation(model, RATE), 0, Clearance(model)
    rows: list[tuple] = []
    over = 0.0
    for tick in range(int(len(people) * RATE / FPS)):
        while image < len(people) and image / FPS <= tick / RATE + 1e-9:
            view = people[image]
            if view is not None:
                robot.see(view, 1 / FPS)
            image += 1
        robot.step()
        at = robot.configuration.data.oMf
        places = {place: at[frame].translation for place, frame in model.frames.items()}
        ankles = [places[f"{side}_ankle"].copy() for side in SIDES]
        over = max(over, (robot.positions - model.highest).max(), (model.lowest - robot.positions).max())
        off = [np.linalg.norm(robot.off_target(f"{side}_wrist")) for side in SIDES]
        touching, mass = bool((clearance.gaps(robot.configuration) < 0).any()), _mass_off(robot, ankles)
        rows.append((robot.positions.copy(), flexions(places), ankles, robot.standing, off, touching, mass))
    columns = [np.array(column) for column in zip(*rows)]
    return Run(*columns, over=max(over, 0.0), unsolved=robot.unsolved)  # type: ignore[arg-type]


def _mass_off(robot: Imitation, ankles: list[np.ndarray]) -> float:
    """Return the horizontal distance, m, of the centre of mass from the line between the ankles that stand."""
    standing = [ankle[:2] for ankle, stands in zip(ankles, robot.standing) if stands]
    if not standing:
        return np.nan
    centre = pin.centerOfMass(robot.model.model, robot.model.model.createData(), robot.configuration.q)[:2]
    along = standing[-1] - standing[0]
    share = np.clip((centre - standing[0]) @ along / max(along @ along, 1e-9), 0.0, 1.0)
    return float(np.linalg.norm(centre - standing[0] - share * along))


def figures(run: Run, people: Sequence[Person | None], scene: Scene, model: RobotModel) -> list[float]:
    """Return the values of COLUMNS after the first."""
    first = round(SCORED_FROM_S * RATE)
    truth = scene.view.truth[: len(people)]
    names = [f"{side[0]}_{name}" for side in SIDES for name in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")]
    true = np.array([flexions(_named(frame, names)) for frame in truth])
    seen = np.array([flexions(_joints(person)) if person is not None else [np.nan] * 4 for person in people])
    ticks, images = np.arange(len(run.positions)) / RATE, np.arange(len(people)) / FPS

    def at(values: np.ndarray, lag: float) -> np.ndarray:
        return np.array([np.interp(ticks - lag, images, column) for column in values.T]).T[first:]

    known = np.where(np.isnan(seen), np.nanmean(seen, axis=0), seen)
    lags = np.arange(0.0, 0.15, 0.0025)
    lag = float(lags[np.argmin([np.abs(run.flexions[first:] - at(known, each)).mean() for each in lags])])
    robot = np.degrees(np.abs(run.flexions[first:] - at(true, lag))).mean(axis=0)
    own = np.degrees(np.abs(at(known, 0.0) - at(true, 0.0))).mean(axis=0)
    beyond = robot - own
    jerk = np.diff(run.positions[first:], 3, axis=0) * RATE**3
    both = (run.standing[1:] & run.standing[:-1])[first:]
    speed = (np.linalg.norm(np.diff(run.ankles[..., :2], axis=0), axis=-1) * RATE)[first:]
    skate, sole = (
        (1e3 * speed[both].mean(), 1e3 * max(0.0, (model.robot.sole - run.ankles[..., 2]).max()))
        if model.free and both.any()
        else (np.nan, np.nan)
    )
    wrist, knees = 1e3 * run.wrist[first:].mean(), beyond[2:].mean() if model.free else np.nan
    rms = float(np.sqrt((jerk**2).mean()))
    contact, mass = 100 * run.touching[first:].mean(), run.mass[first:]
    off_feet = 1e3 * float(np.nanmean(mass)) if model.free and np.isfinite(mass).any() else np.nan
    body = [wrist, beyond[:2].mean(), knees, rms, 1e3 * lag]
    return [*body, skate, sole, contact, off_feet, run.over, run.unsolved]


def _named(frame: np.ndarray, names: Sequence[str]) -> dict[str, np.ndarray]:
    long = {"l": "left", "r": "right"}
    return {f"{long[name[0]]}{name[1:]}": frame[EVALUATED.index(name)] for name in names}


def _joints(person: Person) -> dict[str, np.ndarray]:
    return {name: person.places[index] for name, index in joints.INDEX.items()}


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a row per robot and clip, and the means of each robot."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=os.environ.get("LASSOKIN_DATA"), help="folder with mocap, robots")
    parser.add_argument("--robots", default="g1,h1", help="comma-separated, of those with a URDF in robots (g1,h1)")
    parser.add_argument("--clips", default=CLIPS, help="comma-separated names")
    parser.add_argument("--free", action="store_true", help="with a free base: legs and feet, too")
    parser.add_argument("--seconds", type=float, default=12.0, help="of each clip (12)")
    parser.add_argument("--urdf", action="append", default=[], metavar="ROBOT=FILE", help="URDF outside of robots")
    parser.add_argument("--json", type=Path, help="write the rows")
    options = parser.parse_args(arguments)
    if options.data is None or not (Path(options.data) / "robots").is_dir():
        sys.exit("imitation.py: expected --data DIR, or LASSOKIN_DATA, with the folders mocap and robots")
    folder, names = Path(options.data), options.robots.split(",")
    paths = {**{name: folder / "robots" / file for name, file in URDFS.items()}}
    paths |= {name: Path(path) for name, _, path in (given.partition("=") for given in options.urdf)}
    models = {name: RobotModel(paths[name].read_text(), load_robot(name), options.free) for name in names}
    print(f"{'robot':6} {'clip':16} " + " ".join(f"{name:>10}" for name in COLUMNS), flush=True)
    rows: dict[str, list[list[float]]] = {name: [] for name in names}
    for clip in options.clips.split(","):
        settings = {"noise_px": 3.0, "hold_feet": True}
        job = Job(next(folder.glob(f"*/{clip}.npz")), 0, "lasso", CONDITION, settings=settings, generic_skeleton=True)
        scene = scene_of(job)
        people = tracked(scene, options.seconds)
        if len(people) < (SCORED_FROM_S + 0.5) * FPS:
            print(f"{clip} is shorter than {SCORED_FROM_S + 0.5} s: left out")
            continue
        for name, model in models.items():
            tick = tick_time(people, Imitation(model, RATE))
            rows[name].append([1e3 * tick, *figures(imitated(model, people), people, scene, model)])
            print(f"{name:6} {clip:16} " + " ".join(f"{value:10.3g}" for value in rows[name][-1]), flush=True)
    for name, values in rows.items():
        if values:
            print(f"{name:6} {'mean':16} " + " ".join(f"{value:10.3g}" for value in np.nanmean(values, axis=0)))
    if options.json:
        options.json.write_text(json.dumps({"columns": COLUMNS, "rows": rows}, indent=1))


if __name__ == "__main__":
    main()
