"""The command `viewer`: the tracker's topics in the viewer Rerun, live or recorded to a file."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from lassokin_ros.node.executable import run_node


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the viewer node until SIGINT or SIGTERM. The exit code is 0, or 2 if the node cannot start."""
    given = sys.argv[1:] if arguments is None else list(arguments)
    return run_node(_parser(), partial(_load, given), arguments)


def _load(arguments: Sequence[str]) -> Callable[[], Any]:
    from rclpy.utilities import remove_ros_args

    from lassokin_ros.viewer.node import ViewerNode

    options = _parser().parse_args(remove_ros_args(["viewer", *arguments])[1:])
    return partial(ViewerNode, options.save, options.force)


def _parser() -> argparse.ArgumentParser:
    result = argparse.ArgumentParser(
        prog="viewer",
        description="Show the tracker's topics in the viewer Rerun, or record them for it.",
        epilog="ROS arguments follow --ros-args: -p tracker:=/robot/tracker -r image_raw:=/camera/image_raw",
    )
    result.add_argument("--save", type=Path, metavar="RRD", help="record to a file instead of opening a window")
    result.add_argument("--force", action="store_true", help="replace a file that exists")
    return result


if __name__ == "__main__":
    sys.exit(main())
