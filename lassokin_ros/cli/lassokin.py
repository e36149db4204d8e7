"""The command `lassokin`: one name for all that pip users run.

lassokin track VIDEO|0|IMAGES     pixels to skeleton, without ROS
lassokin replay BAG               the tracker over a rosbag2 recording, without ROS
lassokin tracker --ros-args ...   the ROS 2 node
lassokin detector --ros-args ...  the ROS 2 node that turns images into keypoints
lassokin camera --ros-args ...    the ROS 2 node that publishes a webcam or a video file
lassokin viewer --ros-args ...    the ROS 2 node that shows the tracker's topics in the viewer Rerun
lassokin imitate --ros-args ...   the ROS 2 node that drives a humanoid by the person whom it sees
lassokin retarget NPZ --urdf URDF --robot FILE -o MOTION   a humanoid's motion from a person's
lassokin robot check URDF FILE    does a robot's file fit to its URDF
lassokin measure gait|squat|... VIDEO   the two sides of a gait; squats, lunges, push-ups, rising from a chair
lassokin --version                the version of the package
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Sequence

from lassokin_ros.common.command_line import USAGE_ERROR, version

COMMANDS = {
    "track": ("lassokin_ros.video.command", "main"),
    "replay": ("lassokin_ros.cli.replay", "main"),
    "tracker": ("lassokin_ros.node.command", "tracker"),
    "detector": ("lassokin_ros.node.command", "detector"),
    "camera": ("lassokin_ros.node.command", "camera"),
    "viewer": ("lassokin_ros.viewer.command", "main"),
    "imitate": ("lassokin_ros.node.command", "imitate"),
    "retarget": ("lassokin_ros.robot.retarget", "main"),
    "robot": ("lassokin_ros.robot.check", "main"),
    "measure": ("lassokin_ros.measure.command", "main"),
}
"""Module and function of each sub-command. A module is imported when its sub-command is used."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a sub-command and return its exit code; 2 for an unknown or missing one."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    if given and given[0] in ("-h", "--help"):
        print(__doc__)
        return 0
    if given == ["--version"]:
        print(f"lassokin_ros {version()}")
        return 0
    if not given or given[0] not in COMMANDS:
        problem = f"'{given[0]}' is no command of lassokin" if given else "a command is missing"
        print(f"lassokin: {problem}; expected one of: {', '.join(COMMANDS)}", file=sys.stderr)
        return USAGE_ERROR
    module, function = COMMANDS[given[0]]
    run = getattr(importlib.import_module(module), function)
    sys.argv = [f"lassokin {given[0]}", *given[1:]]
    return int(run())


if __name__ == "__main__":
    sys.exit(main())
