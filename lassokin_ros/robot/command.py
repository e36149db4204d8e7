"""The command `imitate`: joint commands of a robot that imitates a person."""

from __future__ import annotations

import sys

from lassokin_ros.node.executable import node_command

main = node_command(
    "imitate",
    "Publish joint_commands of a humanoid that imitates the person of a tracker, once enabled.",
    "-p robot:=g1; the URDF comes on the topic robot_description",
    "lassokin_ros.robot.node:ImitateNode",
)

if __name__ == "__main__":
    sys.exit(main())
