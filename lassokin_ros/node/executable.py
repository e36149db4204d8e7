"""Run a node as a process: start it, stop it at a signal, and report in one line why it cannot start."""

from __future__ import annotations

import argparse
import os
import re
import signal
import sys
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, InvalidStateError
from contextlib import suppress
from importlib import import_module
from typing import Any

from lassokin_ros.common.command_line import USAGE_ERROR, missing_package

LOG_ADVICE = "set ROS_LOG_DIR to a folder that can be written, or set ROS_HOME or HOME"
LOG_PERIOD_S = 5.0
"""s: between two messages about a callback that fails again and again."""
PAUSE_S = 0.1
"""s: pause after a callback that failed. It keeps a callback that always fails from using a whole core."""


def run_node(
    parser: argparse.ArgumentParser, load: Callable[[], Callable[[], Any]], arguments: Sequence[str] | None
) -> int:
    """Run a node until SIGINT or SIGTERM. The exit code is 0, or 2 if the node cannot start.

    parser: handles the arguments that are not for ROS; its `prog` starts each error message. load: imports the node's
    module and returns the node's class. arguments: the command line without the program's name; None: `sys.argv`.
    """
    stopped = await_signal()
    # The matrices are small. More BLAS threads would be slower, and would take cores from the robot.
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    try:
        from rclpy.utilities import remove_ros_args

        make_node = load()
    except ImportError as error:
        return _print_error(parser.prog, missing_package(error))
    argv = list(sys.argv if arguments is None else [parser.prog, *arguments])
    try:
        parser.parse_args(remove_ros_args(argv)[1:])
        _run(argv, make_node, stopped)
    except Exception as error:
        return _print_error(parser.prog, first_sentence(error))
    return 0


def node_command(program: str, description: str, example: str, node: str) -> Callable[..., int]:
    """Return the function of a command that runs a node, see `run_node`. It takes the arguments, by default `sys.argv`.

    example: ROS arguments, for the help. node: "module:class", imported when the command runs.
    """

    def main(arguments: Sequence[str] | None = None) -> int:
        """Run the node until SIGINT or SIGTERM. The exit code is 0, or 2 if the node cannot start."""
        epilog = f"ROS arguments follow --ros-args: {example}"
        parser = argparse.ArgumentParser(prog=program, description=description, epilog=epilog)
        module, _, name = node.partition(":")
        return run_node(parser, lambda: getattr(import_module(module), name), arguments)

    return main


def run(make_node: Callable[[], Any]) -> None:
    """Run the node that `make_node` returns until SIGINT or SIGTERM. This is for scripts, such as those of `examples/`.

    A signal at any moment ends the script with exit code 0: a callback that is running is finished first. With rclpy's
    own handler, a callback that publishes at that moment raises RCLError.
    """
    _run(sys.argv, make_node, await_signal())


def _run(argv: list[str], make_node: Callable[[], Any], stopped: Future[int]) -> None:
    """Run a node in the global context until `stopped` is done. It is not made after a signal."""
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    node = None
    try:
        rclpy.init(args=argv, signal_handler_options=SignalHandlerOptions.NO)
        if not stopped.done():
            node = make_node()
            spin(node, stopped)
    finally:
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()


def spin(node: Any, stopped: Future[int]) -> None:
    """Spin the node until `stopped` is done or its context ends. An exception out of a callback is logged."""
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
                words = f"a callback failed: {type(error).__name__}: {error}"
                node.get_logger().error(words, throttle_duration_sec=LOG_PERIOD_S)
                time.sleep(PAUSE_S)
    executor.shutdown()


def await_signal() -> Future[int]:
    """Return a future that is done at the first SIGINT or SIGTERM. The signals interrupt nothing from now on.

    The signals are blocked in this thread and in those that it starts. One of them waits for the first signal; later
    signals (ros2 launch sends one to the whole process group) stay pending. Threads that started earlier, such as those
    of a BLAS, may get a signal too: its number then arrives by Python's wakeup file. rclpy's own handler would end the
    context at any moment, for example while a message is published, which then fails.
    """
    signals = (signal.SIGINT, signal.SIGTERM)
    signal.pthread_sigmask(signal.SIG_BLOCK, signals)
    stopped: Future[int] = Future()
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    for number in signals:
        signal.signal(number, lambda *_: None)

    def settle(wait: Callable[[], int]) -> None:
        number = wait()
        with suppress(InvalidStateError):  # the other thread was first
            stopped.set_result(number)

    for wait in (lambda: signal.sigwait(signals), lambda: os.read(reading, 1)[0]):
        threading.Thread(target=settle, args=(wait,), daemon=True).start()
    return stopped


def first_sentence(error: Exception) -> str:
    """Return an exception of rclpy as one line, without the lines of C files."""
    text = re.sub(r"\s*, at \S+:\d+", "", " ".join(str(error).split())) or type(error).__name__
    return f"{text}; {LOG_ADVICE}" if "logging" in text else text


def _print_error(program: str, message: str) -> int:
    """Print one line on stderr. Return the exit code for a wrong use."""
    print(f"{program}: {message}", file=sys.stderr)
    return USAGE_ERROR
