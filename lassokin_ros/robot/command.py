"""The command `imitate`: joint commands of a robot that imitates a person."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from typing import Any

from lassokin_ros.node.executable import run_node


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM. The exit code is 0, or 2 if the node cannot start."""
    return run_node(_parser(), _load, arguments)


def _load() -> Callable[[], Any]:
    from lassokin_ros.robot.node import ImitateNode

    return ImitateNode


def _parser() -> argparse.ArgumentParser:
    return argparse.ArgumentParser(
        prog="imitate",
        description="Publish joint_commands of a humanoid that imitates the person of a tracker, once enabled.",
        epilog="ROS arguments follow --ros-args: -p robot:=g1; the URDF comes on the topic robot_description",
    )


if __name__ == "__main__":
    sys.exit(main())
