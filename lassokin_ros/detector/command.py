"""The command `detector`: starts the node, ends it at a signal, and reports in one line why it cannot start."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from typing import Any

USAGE_ERROR = 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM. The exit code is 0, or 2 if it cannot start."""
    from lassokin_ros.node import command

    stopped = command._await_signal()
    os.environ.setdefault("GLOG_minloglevel", "3")
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    argv = list(sys.argv if arguments is None else ["detector", *arguments])
    node: Any = None
    try:
        import rclpy
        from rclpy.signals import SignalHandlerOptions
        from rclpy.utilities import remove_ros_args

        from lassokin_ros.detector.node import DetectorNode
    except ImportError as error:
        return _complain(f"{error}; the node needs ROS 2's rclpy and common_interfaces, see the README")
    try:
        _parser().parse_args(remove_ros_args(argv)[1:])
        rclpy.init(args=argv, signal_handler_options=SignalHandlerOptions.NO)
        node = DetectorNode()
        command._spin(node, stopped)
    except Exception as error:
        return _complain(command._first_sentence(error))
    finally:
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    return 0


def _parser() -> argparse.ArgumentParser:
    return argparse.ArgumentParser(
        prog="detector",
        description="Images in, 2D keypoints of a person out.",
        epilog="ROS arguments follow --ros-args: -p detector:=mediapipe -r image_raw:=/camera/image_raw",
    )


def _complain(message: str) -> int:
    print(f"detector: {message}", file=sys.stderr)
    return USAGE_ERROR


if __name__ == "__main__":
    sys.exit(main())
