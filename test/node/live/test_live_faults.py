"""The node under faults: bursts, peers that end or stop, signals at any moment."""

import os
import signal
import subprocess
import sys
import time
from collections import Counter
from concurrent.futures import Future
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from itertools import cycle
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy")

from live import (  # noqa: E402
    BACKEND,
    DEADLINE_S,
    NO_HANDLERS,
    NodeProcess,
    Peer,
    complaints,
    node_in_this_process,
    stamp_of,
    values_of,
)
from messages import camera_info, cloud, multi_array, pixels_of_motion  # noqa: E402
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue  # noqa: E402
from rcl_interfaces.srv import SetParameters  # noqa: E402
from rclpy.serialization import serialize_message  # noqa: E402

from lassokin_ros.node.inputs.camera_publishers import LEFTOVER_S  # noqa: E402
from lassokin_ros.node.message_types import message_class  # noqa: E402
from lassokin_ros.node.session_log import UNUSED_MESSAGES  # noqa: E402
from lassokin_ros.pipeline.keypoint_queue import LOST, OVERTAKEN  # noqa: E402
from lassokin_ros.pipeline.outputs import topics  # noqa: E402

PIXELS = pixels_of_motion(120)
STEP_NS, BURST_STEP_NS = 16_666_667, 1_000_000
INT, TERM = signal.SIGINT, signal.SIGTERM
WARN = b"\x01"


@pytest.fixture(scope="module")
def running():
    """(process, peer) of one node that tracks."""
    namespace = "/faults"
    with NodeProcess(namespace, own=True) as node, Peer(namespace) as peer:
        peer.start(PIXELS[0])
        peer.frames_sent, peer.newest_ns = 1, peer.start_ns
        yield node.process, peer


def send(peer, count=1, step_ns=STEP_NS):
    """Send the next frames without a pause; return the stamp of the last."""
    for _ in range(count):
        peer.newest_ns += step_ns
        peer.send(peer.newest_ns, PIXELS[peer.frames_sent % len(PIXELS)])
        peer.frames_sent += 1
    return peer.newest_ns


def answered(peer, stamp):
    """True if the joint states with this stamp have arrived."""
    return any(stamp_of(m) == stamp for m in peer.got[topics.JOINT_STATES])


def counts(peer):
    """The node's counts in its next diagnostics, as numbers."""
    values = values_of(peer.next_diagnostics())
    return {key.removesuffix(" [messages]"): int(v) for key, v in values.items() if key.endswith(" [messages]")}


def increase(peer, before):
    """The increase of each count since `before`, without zeros."""
    return {key: n - before.get(key, 0) for key, n in counts(peer).items() if n != before.get(key, 0)}


@contextmanager
def standing_still(process, probe):
    """A process that is stopped meanwhile, at a moment when it holds no lock of DDS's shared memory.

    A message to a process that holds such a lock blocks the sender for a second and is lost; `probe` sends such a
    message.
    """
    while True:
        process.send_signal(signal.SIGSTOP)
        os.waitid(os.P_PID, process.pid, os.WSTOPPED)
        started = time.monotonic()
        probe()
        if time.monotonic() - started < 0.5:
            break
        process.send_signal(signal.SIGCONT)
    yield
    process.send_signal(signal.SIGCONT)


@contextmanager
def endpoint(role, namespace, **options):
    """test/support/endpoint.py as a process, killed at the end."""
    command = [sys.executable, str(Path(__file__).parents[2] / "support" / "endpoint.py"), role, namespace]
    process = subprocess.Popen(command, **options)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def test_after_a_short_hiccup_every_message_is_used(running):
    process, peer = running
    before, outputs = counts(peer), len(peer.got[topics.JOINT_STATES])
    with standing_still(process, peer.send_camera):
        last = send(peer, 4)
    peer.spin_until(lambda: len(peer.got[topics.JOINT_STATES]) == outputs + 4, what="an answer for each")
    assert answered(peer, last)
    assert increase(peer, before) == {"received": 4, "accepted": 4}


def test_the_newest_message_of_a_burst_is_used_and_the_others_are_counted(running):
    process, peer = running
    before, outputs, sent = counts(peer), len(peer.got[topics.JOINT_STATES]), 300
    since_ns = time.time_ns()
    with standing_still(process, peer.send_camera):
        last = send(peer, sent, BURST_STEP_NS)
    peer.spin_until(lambda: answered(peer, last), what="the newest message's answer")
    status = peer.next_diagnostics(lambda s: OVERTAKEN in s.message, since_ns)
    assert status.level == WARN and f"messages {OVERTAKEN}" in status.message
    new = Counter(increase(peer, before))
    assert new["received"] + new[LOST] == sent
    assert new["accepted"] + new[OVERTAKEN] == new["received"]
    assert new["accepted"] == len(peer.got[topics.JOINT_STATES]) - outputs < 20


def test_messages_faster_than_the_callback_are_answered_without_delay(running):
    """Few answers are published after the newest message was sent, whatever the speed of the machine."""
    _, peer = running
    before, sent, published_ns = counts(peer), 1000, {}

    def keep(message, info):
        published_ns[stamp_of(message)] = info["source_timestamp"]

    name = topics.JOINT_STATES.replace("~", "tracker")
    subscription = peer.node.create_subscription(type(peer.got[topics.JOINT_STATES][-1]), name, keep, 2000)
    others = 0
    while not published_ns:
        first, others = send(peer), others + 1
        peer.spin_until(lambda: answered(peer, first), what="an answer")  # noqa: B023
    last, end_ns = send(peer, sent, BURST_STEP_NS), time.time_ns()
    peer.spin_until(lambda: answered(peer, last) and last in published_ns, what="the newest message's answer")
    assert sum(at > end_ns for at in published_ns.values()) < 0.2 * sent
    new = Counter(increase(peer, before))
    assert new["accepted"] + new[OVERTAKEN] + new[LOST] == sent + others
    peer.node.destroy_subscription(subscription)


def test_broken_data_of_a_right_type_is_counted(running):
    _, peer = running
    before = counts(peer)
    good = serialize_message(BACKEND.make("sensor_msgs/msg/PointCloud2"))
    for data in (b"", good[:20], b"\x00\x01\x00\x00" + b"\xff" * 400, b"this was never serialised by anybody"):
        peer.keypoints.publish(data)
    last = send(peer)
    peer.spin_until(lambda: answered(peer, last), what="an answer")
    assert increase(peer, before) == {"received": 1, "accepted": 1, LOST: 4}


def test_parameters_can_change_during_a_burst(running):
    _, peer = running
    before, sent = counts(peer), 0
    client = peer.node.create_client(SetParameters, "tracker/set_parameters")
    peer.spin_until(client.service_is_ready, what="the service set_parameters")
    futures = []
    for noise in np.linspace(2.0, 9.0, 30):
        value = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=float(noise))
        futures.append(client.call_async(SetParameters.Request(parameters=[Parameter(name="noise_px", value=value)])))
        last = send(peer, 3)
        sent += 3
        # A service's queue has 10 places. Of more requests at a time, some would never be answered.
        peer.spin_until(lambda: sum(not f.done() for f in futures) < 5, what="answers of the service")
    peer.spin_until(lambda: all(f.done() for f in futures) and answered(peer, last), what="all answers")
    assert all(f.result().results[0].successful for f in futures)
    new = Counter(increase(peer, before))
    assert new["accepted"] + new[OVERTAKEN] + new[LOST] == sent
    assert np.isfinite(peer.got[topics.JOINT_STATES][-1].position).all()
    peer.node.destroy_client(client)


def test_a_camera_info_without_publisher_stays_in_use(running):
    _, peer = running
    peer.node.destroy_publisher(peer.camera)
    age = "camera_info age [s]"
    old = float(values_of(peer.next_diagnostics())[age])
    status = peer.next_diagnostics(lambda s: float(values_of(s)[age]) > old + 1)
    assert "camera_info" not in status.message
    last = send(peer)
    peer.spin_until(lambda: answered(peer, last), what="an answer")
    peer.camera = peer.node.create_publisher(type(camera_info(BACKEND)), topics.CAMERA_INFO, 10)


def test_a_stopped_subscriber_does_not_block_the_node(running):
    _, peer = running

    def probe():
        last, started = send(peer), time.monotonic()
        peer.spin_until(lambda: answered(peer, last), what="an answer")
        peer.got[topics.JOINT_STATES].clear()
        return time.monotonic() - started

    with endpoint("sink", peer.namespace, stdout=subprocess.PIPE) as slow:
        assert slow.stdout.readline() == b"ready\n"
        subscribers = peer.node.count_subscribers
        peer.spin_until(lambda: subscribers(f"{peer.namespace}/tracker/joint_states") == 2, what="the other subscriber")
        before = np.median([probe() for _ in range(100)])
        with standing_still(slow, probe):
            waits = [probe() for _ in range(200)]
    assert np.median(waits) < 3 * before + 0.05  # a writer that waits for a subscriber blocks for 0.1 s per topic


def test_a_restarted_publisher_is_used_again():
    namespace = "/publisher_killed"
    with NodeProcess(namespace) as node, Peer(namespace) as peer:
        for _ in range(2):
            peer.got[topics.JOINT_STATES].clear()
            with endpoint("source", namespace):
                peer.spin_until(lambda: len(peer.got[topics.JOINT_STATES]) > 5, what="joint states")
            peer.next_diagnostics(lambda s: s.level == WARN and s.message.startswith("no keypoints for"))
        assert counts(peer)[LOST] == 0
        code, said = node.stop(INT)
    assert (code, "Traceback" in said) == (0, False)


def test_a_restarted_node_answers_within_a_second_of_the_first_usable_frame():
    namespace = "/node_killed"
    with endpoint("source", namespace), Peer(namespace) as peer:
        states = peer.got[topics.JOINT_STATES]
        with NodeProcess(namespace) as first:
            peer.spin_until(lambda: states, what="joint states")
            first.stop(signal.SIGKILL)
        peer.clear()
        with NodeProcess(namespace):
            peer.spin_until(lambda: states, what="joint states")
            late_ns = time.time_ns() - stamp_of(states[0])
            values = counts(peer)
    # The node answers every frame from the first camera_info on, unless it is so busy that newer ones overtake it.
    # DDS determines how soon it and its peers discover each other.
    unanswered = values.get("rejected: no_camera_info", 0) + values["overtaken by newer"]
    assert values["received"] == values["accepted"] + unanswered
    assert late_ns < 1e9


def test_signals_under_load_end_the_node():
    """The nodes track the same keypoints, so that the test is short."""
    namespace, signals = "/under_load", [(INT, INT), (TERM,)]
    with endpoint("source", namespace), Peer(namespace) as peer, ExitStack() as stack:
        names = [f"tracker_{number}" for number in range(len(signals))]
        shared = ("-r", "~/joint_states:=tracker/joint_states")
        nodes = [stack.enter_context(NodeProcess(namespace, "-r", f"__node:={name}", *shared)) for name in names]

        def all_answer():
            answers = Counter(stamp_of(m) for m in peer.got[topics.JOINT_STATES])
            return len(nodes) in answers.values()

        peer.spin_until(all_answer, what="an answer of each node to the same frame")
        ends = [node.stop(*numbers) for node, numbers in zip(nodes, signals)]
    assert [(code, complaints(said)) for code, said in ends] == [(0, [])] * len(signals)


STAGES = ("", "_rclpy_pybind11", "proxsuite", "dds.ev")
"""What a starting node has, in this order: libraries, and a thread of DDS. The first stage needs none of them."""


def test_signals_during_initialisation_end_the_node():
    """At each stage after the process handles signals; before, it has done nothing."""
    signals = [(INT, INT), (INT,), (TERM, TERM), (INT, TERM)]
    end = time.monotonic() + 2 * DEADLINE_S  # four processes start at once, perhaps on a busy machine
    with ExitStack() as stack:
        nodes = [stack.enter_context(NodeProcess("/early", own=True)) for _ in signals]
        waiting = list(zip(nodes, STAGES, signals))
        while waiting:
            assert time.monotonic() < end and all(node.process.poll() is None for node, _, _ in waiting), waiting
            reached = [entry for entry in waiting if has_reached(entry[0].process.pid, entry[1])]
            for entry in reached:
                waiting.remove(entry)
                for number in entry[2]:
                    entry[0].process.send_signal(number)
            time.sleep(0.002)
        ends = [node.stop() for node in nodes]
    assert [(code, complaints(said)) for code, said in ends] == [(0, [])] * len(signals)


def has_reached(pid, stage):
    """True if a process handles signals itself, and has a library or a thread whose name contains `stage`."""
    return may_receive(pid, TERM) and stage in Path(f"/proc/{pid}/maps").read_text() + threads_of(pid)


def threads_of(pid):
    """Names of the threads of a process."""
    names = []
    for file in Path(f"/proc/{pid}/task").glob("*/comm"):
        with suppress(OSError):  # the thread may have ended meanwhile
            names.append(file.read_text())
    return "".join(names)


def may_receive(pid, number):
    """True if a process handles a signal itself: it is blocked, and a thread waits for it."""
    status = Path(f"/proc/{pid}/status").read_text(encoding="ascii")
    blocked = next(line.split()[1] for line in status.splitlines() if line.startswith("SigBlk"))
    return bool(int(blocked, 16) >> (number - 1) & 1)


def test_a_failing_callback_does_not_end_the_node():
    from lassokin_ros.node.executable import spin

    context = rclpy.Context()
    rclpy.init(context=context, signal_handler_options=NO_HANDLERS)
    node, calls = rclpy.create_node("failing", context=context), []

    def fail():
        calls.append(None)
        if len(calls) == 3:
            context.shutdown()
        raise ValueError("on purpose")

    node.create_timer(0.01, fail)
    spin(node, Future())
    assert len(calls) == 3
    node.destroy_node()


def test_no_node_is_made_after_a_signal():
    from lassokin_ros.node.executable import _run

    stopped = Future()
    stopped.set_result(INT)
    _run([], lambda: pytest.fail("a node was made"), stopped)
    assert not rclpy.ok()


def test_waiting_messages_are_stamped_with_their_time_of_arrival():
    namespace, kind = "/waiting", "std_msgs/msg/Float32MultiArray"
    with node_in_this_process(namespace, keypoints_type=kind) as (_, serve), Peer(namespace, kind) as peer:
        states, seen, motion = peer.got[topics.JOINT_STATES], [], cycle(PIXELS)
        peer.node.create_subscription(message_class(kind), topics.KEYPOINTS, seen.append, 10)

        def tracked():
            peer.send_camera()
            peer.keypoints.publish(multi_array(BACKEND, 0, next(motion)))
            serve()
            return states and seen

        peer.spin_until(tracked, what="the first output")
        peer.spin_until(lambda: serve() or len(states) > 1 and peer.keypoints.wait_for_all_acked())
        sent = []
        for _ in range(3):
            seen.clear()
            sent.append(time.time_ns())
            peer.keypoints.publish(multi_array(BACKEND, 0, next(motion)))
            peer.spin_until(lambda: seen and time.time_ns() - sent[-1] > 30_000_000, what="its arrival")
        held_up_until = time.time_ns()
        stamps = lambda: [stamp_of(m) for m in states if stamp_of(m) >= sent[0]]  # noqa: E731
        peer.spin_until(lambda: serve() or len(stamps()) == 3, what="the outputs")
        assert [sum(at <= stamp for at in sent) for stamp in stamps()] == [1, 2, 3]
        assert stamps()[-1] < held_up_until


def test_rejections_and_unusual_inputs_are_logged_and_missing_stamps_once(monkeypatch, capfd):
    monkeypatch.setattr("lassokin_ros.node.log_throttle.SAME_LINE_S", 0.0)
    with node_in_this_process("/unstamped_once") as (node, _):
        node._inputs.camera_info.take(camera_info(BACKEND))
        for index, stamp_ns in enumerate((0, *(time.time_ns() + n * STEP_NS for n in range(3)))):
            node.work_on(cloud(BACKEND, stamp_ns, PIXELS[index]))
        node.work_on(cloud(BACKEND, stamp_ns, PIXELS[0]))
        node._publish_diagnostics()
        for index in range(1, 4):
            node.work_on(cloud(BACKEND, stamp_ns + index * STEP_NS, PIXELS[0], np.zeros(17)))
        node._publish_diagnostics()
        assert node._session.counts["unstamped"] == 1
    said = capfd.readouterr().err
    assert (said.count("without a stamp"), said.count("keypoints rejected (old_stamp): ")) == (1, 1)
    assert said.count("all confidences are 0 or NaN: fill them in the detector") == 1


def test_a_node_of_the_same_name_is_reported_after_a_while():
    """Not at once: the graph contains the publishers of a killed node for some seconds."""
    with node_in_this_process("/twins") as (node, _), node_in_this_process("/twins") as (other, _):
        peer_count = partial(node.count_publishers, "/twins/tracker/state")
        deadline = time.monotonic() + 120
        while peer_count() < 2 and time.monotonic() < deadline:
            time.sleep(0.01)
        assert [node._inputs._duplicate.check(now) for now in (0.0, LEFTOVER_S - 1)] == ["", ""]
        assert node._inputs._duplicate.check(LEFTOVER_S).startswith("another node publishes /twins/tracker/state, too")
        other.destroy_node()
        while peer_count() > 1 and time.monotonic() < deadline:
            time.sleep(0.01)
        assert node._inputs._duplicate.check(LEFTOVER_S + 1) == node._inputs._duplicate.check(LEFTOVER_S + 2) == ""


@pytest.mark.parametrize(("confidence", "lines"), [(0.15, 1), (0.05, 0)])
@pytest.mark.parametrize("max_people", [1, 3])
def test_confidences_slightly_below_the_limit_are_logged_once(confidence, lines, max_people, monkeypatch):
    with node_in_this_process("/unsure", max_people=max_people) as (node, _):
        logged = []
        monkeypatch.setattr(node, "get_logger", lambda: SimpleNamespace(warning=logged.append))
        node._session.set_camera(camera_info(BACKEND))
        for index in range(2 * UNUSED_MESSAGES):
            stamp_ns = 10**12 + index * 33_333_333
            node.work_on(cloud(BACKEND, stamp_ns, PIXELS[index], np.full(17, confidence)))
        assert len([line for line in logged if "nobody was tracked yet" in line]) == lines
