"""A robot that sees random people: does each tick have a solution within the limits?

python benchmarks/robots/fuzz.py --urdf g1.urdf --robot g1 [--free] [--seconds 3600]

Postures follow each other at 30 Hz: noise of 0 to 0.5 m, jumps, NaN, a vertical in any direction, unseen limbs, random
contacts, gaps, holds.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import numpy as np

from lassokin_ros import joints
from lassokin_ros.robot.check import people
from lassokin_ros.robot.imitation import Imitation
from lassokin_ros.robot.model import RobotModel
from lassokin_ros.robot.person import Person
from lassokin_ros.robot.robot_file import load_robot

RATE, FPS = 100.0, 30.0


@dataclass
class Worst:
    """What went wrong in `ticks`: unsolved ones, ticks with NaN, and how far limits were exceeded, rad and s."""

    ticks: int = 0
    followed: int = 0
    unsolved: int = 0
    nan: int = 0
    angle: float = 0.0
    speed: float = 0.0
    acceleration: float = 0.0


def fuzzed(model: RobotModel, seconds: float, seed: int = 0, trusting: bool = True) -> Worst:
    """Return what went wrong. trusting: it follows people who turn faster than people do, too."""
    robot, random, worst = Imitation(model, RATE), np.random.default_rng(seed), Worst()
    views = list(people().values())
    first, view, last, due = model.v_at, views[0], robot.speeds.copy(), 0.0
    for tick in range(round(seconds * RATE)):
        if tick / RATE >= due:
            due += random.choice([1 / FPS, 1 / FPS, 1 / FPS, 0.2])
            if random.random() < 0.03:
                view = _other(views[random.integers(len(views))], random)
            if trusting:
                robot.trust()
            robot.see(_shaken(view, random), random.choice([1 / FPS, 0.0, 0.1]))
            if random.random() < 0.01:
                robot.hold()
        q = robot.step()
        worst.nan += not np.isfinite(q).all()
        beyond = np.maximum(robot.positions - model.highest, model.lowest - robot.positions).max()
        worst.angle = max(worst.angle, float(beyond))
        worst.speed = max(worst.speed, float((np.abs(robot.speeds) - model.speed[first:]).max()))
        change = np.abs(robot.speeds - last) * RATE - model.acceleration[first:]
        worst.acceleration, last = max(worst.acceleration, float(change.max())), robot.speeds.copy()
        worst.ticks, worst.followed, worst.unsolved = tick + 1, worst.followed + (not robot.holding), robot.unsolved
    return worst


def _other(view: Person, random: np.random.Generator) -> Person:
    size = random.choice([0.0, 0.05, 0.2, 0.5])
    return replace(view, places=view.places + size * random.normal(size=view.places.shape))


def _shaken(view: Person, random: np.random.Generator) -> Person:
    places = view.places + random.choice([0.0, 0.01, 0.1]) * random.normal(size=view.places.shape)
    up = view.up
    if random.random() < 0.01:
        places[random.integers(len(joints.NAMES))] = np.nan
    if random.random() < 0.01:
        up = random.normal(size=3)
        up = up / np.linalg.norm(up)
    return Person(places, random.random(len(places)) < 0.95, up, random.random(2) < 0.5)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the counts."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--urdf", type=Path, required=True)
    parser.add_argument("--robot", required=True, help="name or path of the robot's file")
    parser.add_argument("--free", action="store_true", help="with a free base")
    parser.add_argument("--seconds", type=float, default=3600.0, help="of the robot's time (3600)")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    model, start = RobotModel(options.urdf.read_text(), load_robot(options.robot), options.free), time.process_time()
    worst = fuzzed(model, options.seconds, options.seed)
    print(f"{options.robot}: {worst}; {time.process_time() - start:.0f} s of processor time")


if __name__ == "__main__":
    main()
