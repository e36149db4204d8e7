"""The command `tracker`: starts the node, ends it at a signal, and says in one line why it could not start."""

from __future__ import annotations

import argparse
import os
import re
import signal
import sys
import threading
import time
from concurrent.futures import Future
from contextlib import suppress
from typing import Any, Sequence

USAGE_ERROR = 2
PAUSE_S = 0.1
"""s: after a callback that failed, so that one that fails each time does not take a whole core."""


def tracker(arguments: Sequence[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM; the exit code: 0, or 2 when it could not start."""
    stopped = _await_signal()
    # The matrices are small: further threads of BLAS cost more than they bring, and take cores from the robot.
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    try:
        import rclpy
        from rclpy.signals import SignalHandlerOptions
        from rclpy.utilities import remove_ros_args

        from lassokin_ros.core.errors import LassokinError
        from lassokin_ros.node.node import TrackerNode
    except ImportError as error:
        return _complain(f"{error}; the node needs ROS 2's rclpy and common_interfaces, see the README")
    argv = list(sys.argv if arguments is None else ["tracker", *arguments])
    node = None
    try:
        _parser().parse_args(remove_ros_args(argv)[1:])
        rclpy.init(args=argv, signal_handler_options=SignalHandlerOptions.NO)
        node = TrackerNode()
        _spin(node, stopped)
    except LassokinError as error:
        return _complain(str(error))
    except Exception as error:
        return _complain(_first_sentence(error))
    finally:
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    return 0


def _spin(node: Any, stopped: Future[int]) -> None:
    """Serve the node until a signal or its context's end; an exception out of a callback is said, and survived."""
    from rclpy.exceptions import InvalidHandle
    from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

    def wake(_: Future[int]) -> None:
        with suppress(InvalidHandle):  # the node may have ended meanwhile
            guard.trigger()

    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    guard = node.create_guard_condition(lambda: None)
    stopped.add_done_callback(wake)
    while not stopped.done() and node.context.ok():
        try:
            executor.spin_once()
        except ExternalShutdownException:
            break
        except Exception as error:
            if node.context.ok():
                node.get_logger().error(f"a callback failed: {type(error).__name__}: {error}")
                time.sleep(PAUSE_S)
    executor.shutdown()


def _await_signal() -> Future[int]:
    """Done at the first SIGINT or SIGTERM; from now to the process's end they interrupt nothing.

    They are blocked in every thread, and one of its own waits for the first; later ones (launch sends one to the whole
    group) stay pending. rclpy's handler would end its context at any moment, that of a message being logged or
    published too, which then fails.
    """
    signals = (signal.SIGINT, signal.SIGTERM)
    signal.pthread_sigmask(signal.SIG_BLOCK, signals)
    stopped: Future[int] = Future()
    threading.Thread(target=lambda: stopped.set_result(signal.sigwait(signals)), daemon=True).start()
    return stopped


def _parser() -> argparse.ArgumentParser:
    return argparse.ArgumentParser(
        prog="tracker",
        description="2D keypoints and camera_info in, a 3D skeleton with joint angles out.",
        epilog="ROS arguments follow --ros-args: -p height:=1.80 --params-file FILE -r keypoints:=/detector/keypoints",
    )


def _first_sentence(error: Exception) -> str:
    """One line of an exception from rclpy, whose messages name lines of C files."""
    return re.sub(r"\s*, at \S+:\d+", "", " ".join(str(error).split())) or type(error).__name__


def _complain(message: str) -> int:
    print(f"tracker: {message}", file=sys.stderr)
    return USAGE_ERROR


if __name__ == "__main__":
    sys.exit(tracker())
