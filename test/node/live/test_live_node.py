"""The running node: parameters, diagnostics, rejected inputs, a camera that comes late."""

import signal
import time

import numpy as np
import pytest

pytest.importorskip("rclpy")

from live import NodeProcess, Peer, stamp_of, values_of  # noqa: E402
from live_session import (  # noqa: E402
    PIXELS,
    feed,
    feed_in_time,
    get_parameter,
    parameter,
    restart,
    send_next,
    send_until_rejected,
    set_parameters,
)
from messages import FRAME  # noqa: E402
from rcl_interfaces.srv import ListParameters, SetParametersAtomically  # noqa: E402
from std_srvs.srv import SetBool, Trigger  # noqa: E402

from lassokin_ros.core.config import TrackerConfig  # noqa: E402
from lassokin_ros.pipeline.outputs import topics  # noqa: E402

OK, WARN, ERROR = b"\x00", b"\x01", b"\x02"


@pytest.fixture(scope="module")
def running():
    """A node that tracks, and its peer; `feed` sends the next frames of one motion."""
    namespace = "/running"
    with NodeProcess(namespace, "-p", "height:=1.75", "-p", "stale_after:=30.0"), Peer(namespace) as peer:
        peer.start(PIXELS[0])
        peer.frames_sent = 0
        yield peer


def test_there_are_no_unrequested_qos_parameters(running):
    listed = running.call(ListParameters, "list_parameters", ListParameters.Request()).result.names
    assert not [name for name in listed if name.startswith("qos_overrides./running/")]


def test_start_reset_and_switch_log_one_line_each():
    with NodeProcess("/spoken", "-r", "keypoints:=/detector/points", "-p", "height:=1.6") as node:
        with Peer("/spoken", outputs=False) as peer:
            peer.next_diagnostics()
            peer.call(Trigger, "reset", Trigger.Request())
            for value in (False, False, True):
                peer.call(SetBool, "set_enabled", SetBool.Request(data=value))
        _, said = node.stop(signal.SIGINT)
    (start,) = [line for line in said.splitlines() if "]: lassokin_ros " in line]
    assert "height 1.6 m, landmarks coco17, reads /detector/points, /spoken/camera_info" in start
    assert start.endswith("publishes /spoken/tracker/...")
    assert [said.count(f"]: {words}") for words in ("reset: ", "disabled", "enabled")] == [1, 1, 1]


def test_bad_values_are_refused_with_the_reason(running):
    structure, too_small, wrong_type, too_large = (
        set_parameters(running, **{name: value})[0]
        for name, value in (("landmarks", "body25"), ("noise_px", -5.0), ("noise_px", "much"), ("min_landmarks", 1000))
    )
    for result, word in (
        (structure, "read-only"),
        (too_small, "noise_px"),
        (wrong_type, "DOUBLE"),
        (too_large, "min_landmarks"),
    ):
        assert not result.successful and word in result.reason, result
    assert get_parameter(running, "landmarks") == "coco17"
    assert get_parameter(running, "noise_px") == 3.0
    assert get_parameter(running, "min_landmarks") == 4


def test_several_values_are_applied_together_or_not_at_all(running):
    """One of them is out of range, or read-only."""
    for name, value, word in (("noise_px", 1e9, "noise_px"), ("max_people", 3, "read-only")):
        values = [parameter("sparsity", 0.5), parameter(name, value)]
        request = SetParametersAtomically.Request(parameters=values)
        result = running.call(SetParametersAtomically, "set_parameters_atomically", request).result
        assert not result.successful and word in result.reason
        assert get_parameter(running, "sparsity") == TrackerConfig().sparsity
    assert get_parameter(running, "max_people") == 1
    feed(running)


def test_a_live_change_takes_effect_on_the_next_frame(running):
    feed(running, confidence=0.5)
    assert set_parameters(running, min_confidence=0.6)[0].successful
    send_until_rejected(running, "too_few_landmarks", lambda: send_next(running, confidence=0.5))
    assert set_parameters(running, min_confidence=0.2)[0].successful
    feed(running, confidence=0.5)


def test_a_disabled_node_reports_this_and_publishes_nothing(running):
    feed(running, 2)
    outputs = len(running.got[topics.JOINT_STATES])
    response = running.call(SetBool, "set_enabled", SetBool.Request(data=False))
    assert (response.success, response.message) == (True, "disabled")
    assert running.call(SetBool, "set_enabled", SetBool.Request(data=False)).message == "disabled already"
    for _ in range(3):
        send_next(running)
    key = "ignored while disabled [messages]"
    status = running.next_diagnostics(lambda s: values_of(s)[key] == "3")
    assert (status.level, status.message) == (OK, "disabled by ~/set_enabled")
    assert len(running.got[topics.JOINT_STATES]) == outputs
    assert running.call(SetBool, "set_enabled", SetBool.Request(data=True)).message == "enabled"
    feed(running)
    assert values_of(running.got[topics.CERTIFICATE][-1])["initialised"] == "true"


def test_diagnostics_while_tracking_are_complete(running):
    restart(running)  # the motion is that of 3 s
    feed(running)
    running.settle()
    running.got[topics.DIAGNOSTICS].clear()
    feed_in_time(running, lambda: len(running.got[topics.DIAGNOSTICS]) > 1)
    message = running.got[topics.DIAGNOSTICS][1]
    status, values = message.status[0], values_of(message)
    assert (status.name, status.hardware_id) == ("running/tracker: person", FRAME)
    assert status.message.startswith("tracking")
    assert status.level == OK or status.message != "tracking"  # a machine with other load may cause a warning
    assert values["state"] == "tracking"
    assert float(values["input rate [Hz]"]) > 1
    assert values["input rate [Hz]"] == values["output rate [Hz]"]
    assert 0 <= float(values["keypoints age [s]"]) < 1
    assert float(values["camera_info age [s]"]) > 0
    assert 0 < float(values["callback time median [ms]"]) <= float(values["callback time maximum [ms]"])
    assert 0 < float(values["reprojection error [px]"]) < 20
    assert int(values["accepted [messages]"]) <= int(values["received [messages]"])
    assert stamp_of(message) > 1e18  # the time of the wall clock


def test_rejected_keypoints_are_counted_by_reason_and_keep_the_state(running):
    feed(running, 3)
    old = running.start_ns + (running.frames_sent - 1) * 16_666_667
    wrong = {
        "unknown_id": {"ids": np.arange(17) + 1},
        "repeated_id": {"ids": np.zeros(17, int)},
        "confidence_range": {"confidence": 90.0},
        "too_few_landmarks": {"confidence": 0.0},
    }
    counts = values_of(running.next_diagnostics())
    before = {reason: int(counts.get(f"rejected: {reason} [messages]", 0)) for reason in ("old_stamp", *wrong)}
    outputs, since_ns = len(running.got[topics.JOINT_STATES]), time.time_ns()
    for options in wrong.values():
        send_next(running, **options)
    running.send(old, PIXELS[0])

    def all_counted(status):
        counts = values_of(status)
        return all(counts.get(f"rejected: {reason} [messages]") == str(n + 1) for reason, n in before.items())

    running.next_diagnostics(all_counted)
    status = running.next_diagnostics(lambda s: "unknown_id" in s.message, since_ns)
    assert status.level == WARN
    assert len(running.got[topics.JOINT_STATES]) == outputs
    feed(running)
    assert values_of(running.got[topics.CERTIFICATE][-1])["initialised"] == "false"


def test_no_output_before_a_usable_camera_info():
    namespace = "/no_camera"
    with NodeProcess(namespace) as node, Peer(namespace) as peer:
        peer.frames_sent = 0
        status = peer.next_diagnostics(lambda s: s.hardware_id == "none")
        assert (status.level, status.message) == (WARN, "waiting for camera_info")
        peer.spin_until(lambda: peer.keypoints.get_subscription_count() and peer.camera.get_subscription_count())

        def refused(status):
            send_next(peer)
            peer.send_camera(k=np.zeros(9))
            values = values_of(status)
            return int(values.get("rejected: no_camera_info [messages]", 0)) > 0 and status.level == ERROR

        status = peer.next_diagnostics(refused)
        assert "K[0] = 0" in status.message
        assert int(values_of(status)["rejected: camera_uncalibrated [messages]"]) > 0
        assert not any(peer.got[topic.name] for topic in topics.FRAME_OUTPUTS)
        peer.spin_until(lambda: [peer.send_camera(), send_next(peer)] and peer.got[topics.JOINT_STATES])
        # A later invalid camera_info does not replace the good one.
        peer.send_camera(k=np.zeros(9))
        status = peer.next_diagnostics(lambda s: s.level == ERROR)
        assert "last good one is used" in status.message
        outputs = len(peer.got[topics.JOINT_STATES])
        peer.spin_until(lambda: [send_next(peer)] and len(peer.got[topics.JOINT_STATES]) > outputs)
    assert "camera_info refused: camera_info has K[0] = 0" in node.said
