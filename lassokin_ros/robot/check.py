"""The command `lassokin robot check URDF FILE`: what does not fit, and a picture of robot and person side by side."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from lassokin_ros import joints
from lassokin_ros.common.atomic_files import AtomicFiles, refuse_existing
from lassokin_ros.common.command_line import USAGE_ERROR, print_summary
from lassokin_ros.common.svg import Axes, document, text
from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.errors import LassokinError
from lassokin_ros.core.yaml_files import read_text
from lassokin_ros.robot.imitation import Imitation
from lassokin_ros.robot.model import RobotModel
from lassokin_ros.robot.person import Person, posture
from lassokin_ros.robot.robot_file import ARM_BONES, BONES, CHAINS, SHIPPED, SIDES, RobotError, load_robot

PROGRAM = "lassokin robot"
POSTURES: dict[str, dict[str, tuple[float, float, float]]] = {
    "arms down": {"left_shoulder": (0, 0, -1.3), "right_shoulder": (0, 0, 1.3)},
    "arms to the sides": {},
    "arms forward": {"left_shoulder": (0, -1.4, 0), "right_shoulder": (0, 1.4, 0)},
    "elbows bent": {
        **{"left_shoulder": (0, 0, -1.2), "right_shoulder": (0, 0, 1.2)},
        **{"left_elbow": (0, -1.5, 0), "right_elbow": (0, 1.5, 0)},
    },
    "right arm raised": {"left_shoulder": (0, 0, -1.3), "right_shoulder": (0, 0, -1.2)},
    "on the left leg": {
        **{"left_shoulder": (0, 0, -1.3), "right_shoulder": (0, 0, 1.3)},
        **{"right_hip": (-1.0, 0, 0), "right_knee": (1.2, 0, 0)},
    },
}
"""Rotation vectors, rad, of joints that are not as in the T-pose (x left, y up, z front)."""
UP = np.array([0.0, 1.0, 0.0])
SETTLE_S = 4.0
COLUMN, TALL = 150, 250  # px
LEFT, RIGHT, MIDDLE = "#1f6fb4", "#d1495b", "#3c3c46"


def people() -> dict[str, Person]:
    """Return a person of 1.7 m in each of POSTURES."""
    skeleton = Skeleton.load(TrackerConfig().skeleton, 1.7)
    body = Kinematics(skeleton, Layout.load("coco17", skeleton))
    result = {}
    for name, turns in POSTURES.items():
        vectors = np.zeros((skeleton.joint_count, 3))
        for joint, turn in turns.items():
            vectors[skeleton.index(joint)] = turn
        places = body.pose(BodyState(exponential(vectors), np.zeros(3))).positions
        heights = places[[joints.LEFT_ANKLE, joints.RIGHT_ANKLE]] @ UP
        result[name] = Person(places, np.ones(len(places), dtype=bool), UP, heights < heights.min() + 0.1)
    return result


def settled(model: RobotModel, person: Person) -> Imitation:
    """Return a robot that has imitated a still person for SETTLE_S."""
    robot = Imitation(model, 50.0)
    robot.see(person, 0.0)
    for _ in range(round(SETTLE_S / robot.period)):
        robot.step()
    return robot


def bone_angles(robot: Imitation, person: Person) -> dict[str, float]:
    """Return the angle, degrees, between each bone of the robot and that of the person, in axes of torso or base."""
    model, at = robot.model, robot.configuration.data.oMf
    wanted, result = posture(person.places, person.up).bones, {}
    for bone, direction in zip(BONES[: None if model.free else ARM_BONES], wanted):
        along = at[model.frames[bone.far]].translation - at[model.frames[bone.near]].translation
        along = model.axes[bone.owner].T @ at[model.frames[bone.owner]].rotation.T @ along
        cosine = float(np.clip(along @ direction / np.linalg.norm(along), -1, 1))
        result[bone.far] = float(np.degrees(np.arccos(cosine)))
    return result


def report(model: RobotModel) -> tuple[list[str], str]:
    """Return the lines about the robot, and the picture."""
    lines = [f"{model.robot.name}: {len(model.names)} joints: {', '.join(model.names)}", *model.remarks()]
    parts = [text((20, 20 + 18), "person"), text((20, 20 + TALL + 58), model.robot.name)]
    shown = people()
    for column, (name, person) in enumerate(shown.items()):
        robot = settled(model, person)
        off = bone_angles(robot, person)
        worst = max(off, key=lambda far: off[far])
        lines.append(
            f"{name}: bones off by {np.mean(list(off.values())):.0f} degrees on average, {worst} by {off[worst]:.0f}"
        )
        turn = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])  # to x front, y left, z up
        named = {place: turn @ person.places[joints.INDEX[_JOINT.get(place, place)]] for place in model.frames}
        at = model.places(robot.configuration.q)
        for row, places in enumerate((named, at)):
            parts.append(_view(places, (20 + column * (COLUMN + 10), 50 + row * (TALL + 40)), name if row == 0 else ""))
    width = 30 + len(shown) * (COLUMN + 10)
    return lines, document((width, 2 * (TALL + 40) + 40), parts)


_JOINT = {"base": "pelvis", "torso": "neck"}
"""The person's joint at the places that are no joints."""


def _view(places: dict[str, np.ndarray], corner: tuple[float, float], title: str) -> str:
    """Return the view from the front and 40 degrees from the left of the bones between places (3,) m."""
    across = np.array([np.sin(-0.7), np.cos(-0.7), 0.0])  # the viewer's left
    flat = {
        name: np.array([-(place - places["base"]) @ across, (place - places["base"])[2]])
        for name, place in places.items()
    }
    size = max(np.abs(point).max() for point in flat.values()) * 1.1
    axes = Axes(corner, (COLUMN, TALL), (-size * COLUMN / TALL, size * COLUMN / TALL), (-size, size))
    axes.line(np.array([flat["base"], flat["torso"]]), MIDDLE, 3)
    for side, colour in zip(SIDES, (LEFT, RIGHT)):
        for chain, names in CHAINS.items():
            root = "torso" if chain == "arm" else "base"
            axes.line(np.array([flat[root], *(flat[f"{side}_{joint}"] for joint in names)]), colour, 3)
    axes.label(title)
    return axes.svg()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code: 0, or 2 with one line on stderr."""
    options = _parser().parse_args(arguments)
    try:
        refuse_existing(options.picture, options.force, RobotError)
        urdf, robot = read_text(options.urdf, RobotError), load_robot(options.file)
        lines, picture = report(RobotModel(urdf, robot, not options.upper_body))
        with AtomicFiles(options.force, RobotError) as files:
            files.write_text(options.picture, picture)
        print_summary("\n".join([*lines, f"wrote {options.picture}: person and robot side by side"]))
    except LassokinError as error:
        print(f"{PROGRAM} {options.what}: {error}", file=sys.stderr)
        return USAGE_ERROR
    return 0


def _parser() -> argparse.ArgumentParser:
    result = argparse.ArgumentParser(prog=PROGRAM, description="Does a robot's file fit to its URDF, and to a person?")
    result.add_argument("what", choices=("check",))
    result.add_argument("urdf", type=Path, metavar="URDF")
    result.add_argument("file", metavar="FILE", help=f"the robot's file: {', '.join(SHIPPED)}, or a path")
    result.add_argument("--picture", type=Path, default=Path("robot.svg"), metavar="SVG", help="robot.svg")
    result.add_argument("--upper-body", action="store_true", help="arms and torso alone, on a base that does not move")
    result.add_argument("--force", action="store_true", help="replace a picture that exists")
    return result


if __name__ == "__main__":
    sys.exit(main())
