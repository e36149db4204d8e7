"""The command `lassokin retarget`: a robot's motion from a person's, which --export of track or replay wrote."""

from __future__ import annotations

import argparse
import pickle
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from lassokin_ros import joints
from lassokin_ros.common.atomic_files import AtomicFiles, refuse_existing
from lassokin_ros.common.command_line import USAGE_ERROR, print_summary
from lassokin_ros.common.progress import Progress
from lassokin_ros.core.errors import LassokinError
from lassokin_ros.core.yaml_files import read_text
from lassokin_ros.measure.poses import LONGEST_GAP_S, Poses, read_poses
from lassokin_ros.robot.imitation import Imitation
from lassokin_ros.robot.model import RobotModel
from lassokin_ros.robot.person import ANKLES, Course, Person
from lassokin_ros.robot.robot_file import SHIPPED, RobotError, load_robot

PROGRAM = "lassokin retarget"
LEVEL_UP = np.array([0.0, -1.0, 0.0])
"""The vertical of `Poses`."""
START_S = 2.0
"""s before the first image in which the robot goes from its rest to the person. They are not written."""


@dataclass(frozen=True, eq=False)
class RobotMotion:
    """A robot's motion. seconds: (f,), of the person's file. names: of m joints, all of the URDF in its order.

    positions: (f, m) rad (m). base: (f, 7) place, m, and quaternion x, y, z, w; the floor is at z = 0. following: (f,)
    bool, False while the robot holds.
    """

    seconds: np.ndarray
    names: tuple[str, ...]
    positions: np.ndarray
    base: np.ndarray
    following: np.ndarray
    rate: float


def retarget(poses: Poses, model: RobotModel, rate: float, progress: Progress) -> RobotMotion:
    """Return the robot's motion at `rate` Hz. Raises RobotError for another skeleton than the built-in one.

    Frames that are likely wrong are not used. The robot holds in gaps of LONGEST_GAP_S and more. It is not late.
    """
    if poses.names != joints.NAMES:
        raise RobotError(f"the motion has {len(poses.names)} joints; expected one of the built-in skeleton")
    robot = Imitation(model, rate)
    period = float(np.median(np.diff(poses.seconds)))
    ahead = period + Course.LAG  # s, by which the robot would be late
    ticks = np.arange(-START_S, poses.seconds[-1] - poses.seconds[0], 1 / rate) + poses.seconds[0]
    observed = np.ones(poses.positions.shape[:2], dtype=bool) if poses.observed is None else poses.observed
    contacts = np.zeros_like(observed) if poses.contacts is None else poses.contacts
    rows, bases, following = [], [], []
    at, seen_s = 0, -np.inf
    for now in ticks:
        while at < len(poses.seconds) and (poses.seconds[at] <= now + ahead or at == 0):
            if not poses.likely_wrong[at]:
                view = Person(poses.positions[at], observed[at], LEVEL_UP, contacts[at][ANKLES])
                interval = poses.seconds[at] - seen_s
                if not robot.see(view, min(interval, LONGEST_GAP_S) if np.isfinite(interval) else 0.0):
                    seen_s = float(poses.seconds[at])
            at += 1
            progress.advance()
        if now + ahead - max(seen_s, poses.seconds[0]) > LONGEST_GAP_S:
            robot.hold()
        robot.step()
        rows.append(model.whole(robot.positions))
        bases.append(robot.base.copy() if model.free else np.array([0.0, 0, 0, 0, 0, 0, 1]))
        following.append(not robot.holding)
    shown = ticks >= poses.seconds[0]
    arrays = (np.array(each)[shown] for each in (rows, bases, following))
    positions, base, followed = arrays
    return RobotMotion(ticks[shown], model.all_names, positions, base, followed, rate)


def write_csv(motion: RobotMotion, file: BinaryIO) -> None:
    """Write a row per frame: seconds, following, base, joints."""
    head = [
        "seconds",
        "following",
        *(f"base_{name}" for name in ("x", "y", "z", "qx", "qy", "qz", "qw")),
        *motion.names,
    ]
    table = np.column_stack([motion.seconds, motion.following, motion.base, motion.positions])
    np.savetxt(file, table, "%.6g", ",", header=",".join(head), comments="")


def write_npz(motion: RobotMotion, file: BinaryIO) -> None:
    """Write the arrays of a RobotMotion."""
    fields = {name: getattr(motion, name) for name in ("seconds", "positions", "base", "following")}
    np.savez(file, joint_names=np.array(motion.names), rate=np.array(motion.rate), **fields)


def write_pickle(motion: RobotMotion, file: BinaryIO) -> None:
    """Write the keys that followers of GMR's motions read (bvh_to_robot.py of GMR); root_rot is x, y, z, w."""
    keys = {
        "fps": motion.rate,
        "root_pos": motion.base[:, :3],
        "root_rot": motion.base[:, 3:],
        "dof_pos": motion.positions,
    }
    pickle.dump({**keys, "local_body_pos": None, "link_body_list": None, "dof_names": list(motion.names)}, file)


WRITERS: dict[str, Callable[[RobotMotion, BinaryIO], None]] = {
    ".csv": write_csv,
    ".npz": write_npz,
    ".pkl": write_pickle,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code: 0, or 2 with one line on stderr."""
    options = _parser().parse_args(arguments)
    try:
        _run(options)
    except LassokinError as error:
        print(f"{PROGRAM}: {error}", file=sys.stderr)
        return USAGE_ERROR
    return 0


def _run(options: argparse.Namespace) -> None:
    if not 10 <= options.rate <= 1000:
        raise RobotError(f"--rate {options.rate:g}: expected 10 to 1000 Hz")
    for path in options.output:
        if path.suffix not in WRITERS:
            raise RobotError(f"--output '{path}': expected a name that ends in {', '.join(WRITERS)}")
        refuse_existing(path, options.force, RobotError)
    model = RobotModel(read_text(options.urdf, RobotError), load_robot(options.robot), not options.upper_body)
    poses = read_poses(options.motion, options.person)
    progress = Progress(len(poses.seconds), "frames", plain_lines=4)
    motion = retarget(poses, model, options.rate, progress)
    progress.close()
    with AtomicFiles(options.force, RobotError) as files:
        for path in options.output:
            files.write(path, lambda file, write=WRITERS[path.suffix]: write(motion, file))  # type: ignore[misc]
    lines = [f"{len(motion.seconds)} frames at {motion.rate:g} Hz, {len(motion.names)} joints"]
    if not motion.following.all():
        lines.append(
            f"the robot holds in {1 - motion.following.mean():.0%} of them: the person is not seen, or doubtful"
        )
    print_summary("\n".join([*lines, *(f"wrote {path}" for path in options.output)]))


def _parser() -> argparse.ArgumentParser:
    result = argparse.ArgumentParser(prog=PROGRAM, description="A robot's motion from a person's.")
    result.add_argument("motion", type=Path, metavar="NPZ", help="a .npz that --export of track or replay wrote")
    result.add_argument("--urdf", type=Path, required=True, help="of the robot")
    result.add_argument(
        "--robot", required=True, metavar="FILE", help=f"the robot's file: {', '.join(SHIPPED)}, or a path"
    )
    result.add_argument(
        "--output", "-o", type=Path, action="append", required=True, metavar="FILE", help="csv, npz or pkl"
    )
    result.add_argument("--upper-body", action="store_true", help="arms and torso alone, on a base that does not move")
    result.add_argument("--rate", type=float, default=50.0, metavar="HZ", help="of the robot's motion (50)")
    result.add_argument("--person", metavar="ID", help="whose motion, if the file has several people: p1")
    result.add_argument("--force", action="store_true", help="replace files that exist")
    return result


if __name__ == "__main__":
    sys.exit(main())
