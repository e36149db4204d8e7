"""Start and end of the process: signals and bad arguments. test_live_faults.py ends nodes by signals."""

import os
import signal
import subprocess
import sys

import pytest

pytest.importorskip("rclpy")

from forked import Forked  # noqa: E402
from live import ROOT, TRACKER, NodeProcess, Peer  # noqa: E402


def test_a_signal_that_an_earlier_thread_gets_interrupts_nothing():
    """Such as those of a BLAS, which numpy starts as it is imported."""
    code = (
        "import threading, time; threading.Thread(target=time.sleep, args=(60,), daemon=True).start()\n"
        "from lassokin_ros.node.executable import await_signal; stopped = await_signal(); print('ready', flush=True)\n"
        "while not stopped.done(): time.sleep(0.01)\n"
        "print(stopped.result(), flush=True)"
    )
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, cwd=ROOT)
    assert process.stdout.readline() == "ready\n"
    process.send_signal(signal.SIGINT)
    output, _ = process.communicate(timeout=60)
    assert (output, process.returncode) == (f"{signal.SIGINT.value}\n", 0)


@pytest.mark.parametrize(
    "arguments, word",
    [
        (["--ros-args", "-p", "height:=5.0"], "0 to 2.6 m"),
        (["--ros-args", "-p", "height:=2"], "decimal point"),
        (["--ros-args", "-p", "fixedframe:=odom"], "did you mean 'fixed_frame'?"),
        (["--ros-args", "-p", "skeleton:=nobody"], "anthropometric"),
        (["--ros-args", "-p", "landmarks:=nothing"], "coco17"),
        (["--ros-args", "-p", "solver:=guess"], "proxqp"),
        (["--ros-args", "-p", "keypoints_type:=sensor_msgs/Image"], "sensor_msgs/msg/PointCloud2"),
        (["--ros-args", "-p", "keypoints_type:=zed_msgs/ObjectsStamped"], "ros-$ROS_DISTRO-zed-msgs"),
        (["--ros-args", "--params-file", "not_there.yaml"], "not_there.yaml"),
        (["--ros-args", "--params-file", "README.md"], "README.md"),
    ],
)
def test_a_failed_start_is_explained_in_one_line(arguments, word):
    process = Forked([*TRACKER, *arguments])
    lines = process.communicate(timeout=120)[1].strip().splitlines()
    assert process.returncode == 2, lines
    assert len(lines) == 1 and lines[0].startswith("tracker: ") and word in lines[0], lines


def test_a_home_that_cannot_be_written_is_one_line_with_the_remedy():
    """ROS writes its logs there."""
    environment = {k: v for k, v in os.environ.items() if k not in ("ROS_LOG_DIR", "ROS_HOME")}
    environment["HOME"] = "/proc/nowhere"
    done = subprocess.run(TRACKER, capture_output=True, text=True, cwd=ROOT, timeout=120, env=environment)
    assert done.returncode == 2 and done.stderr.count("\n") == 1, done.stderr
    assert done.stderr.startswith("tracker: ") and "set ROS_LOG_DIR" in done.stderr


def test_a_qos_policy_that_cannot_be_overridden_is_reported():
    own, other = "qos_overrides./overridden/camera_info.subscription", "qos_overrides./image.subscription"
    settings = [f"{own}.durability:=transient_local", f"{own}.depth:=2", f"{other}.durability:=transient_local"]
    with NodeProcess("/overridden", *(word for item in settings for word in ("-p", item))) as node:
        with Peer("/overridden") as peer:
            peer.next_diagnostics()
        _, said = node.stop(signal.SIGINT)
    assert said.count("there is no parameter") == 1 and f"'{own}.durability'" in said
