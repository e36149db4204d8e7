"""What the node passes to the core and reports of it: solves, own evidence, limitations, files that are gone."""

import time
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from cases import copied_body  # noqa: E402
from faults.own_evidence import Faulty, Floor  # noqa: E402
from faults.solves import counted_solves  # noqa: E402
from live import BACKEND, node_in_this_process  # noqa: E402
from messages import camera_info, cloud, pixels_of_motion  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402

from lassokin_ros.pipeline.outputs.scene_messages import LOST, NOBODY, TRACKING  # noqa: E402

START_NS, PERIOD_NS, FRAMES = 10**18, 33_333_333, 40
PIXELS = pixels_of_motion(FRAMES, 30.0)
ANKLES = [7, 8]


def feed(node, first=0, count=FRAMES):
    """Give the node camera_info and frames, as its subscriptions do."""
    node._inputs.camera_info.take(camera_info(BACKEND))
    before = node._session.counts["accepted"]
    for i in range(first, first + count):
        node.work_on(cloud(BACKEND, START_NS + i * PERIOD_NS, PIXELS[i % FRAMES]))
    assert node._session.counts["accepted"] == before + count, node._session.counts


def ankles(node):
    """Mean of both ankles after some frames, m below the camera's axis."""
    feed(node)
    tracker = node._session.tracker
    return tracker.kinematics.pose(tracker.state).positions[ANKLES, 1].mean()


def values(node):
    """The values of the node's diagnostics."""
    return node._diagnostics.line(time.monotonic()).values


def test_proxqp_solves_every_lasso_of_the_node_once(monkeypatch):
    counts = counted_solves(monkeypatch)
    with node_in_this_process("/solving") as (node, _):
        feed(node)
    assert counts["lassos"] >= FRAMES and counts["nontrivial"] > 0.9 * FRAMES
    assert counts["qp"] == counts["nontrivial"] == counts["by proxqp"], counts


def test_own_evidence_is_used_and_a_faulty_one_is_named_once(capfd):
    fault = "evidence 'faulty' is left out: ZeroDivisionError: no floor here"
    with node_in_this_process("/no_floor") as (node, _):
        without = ankles(node)
    with node_in_this_process("/floor", [Floor(ANKLES, without - 0.1), Faulty()]) as (node, _):
        assert ankles(node) < without - 0.05
        assert values(node)["evidence 'faulty'"] == fault and "evidence 'floor'" not in values(node)
    said = capfd.readouterr().err
    assert said.count(fault) == 1, said


def test_limitations_of_a_skeleton_are_reported(tmp_path, capfd):
    files = copied_body(tmp_path)
    skeleton = Path(files["skeleton"])
    skeleton.write_text(skeleton.read_text().replace("left_foot", "left_toes"))
    with node_in_this_process("/renamed", **files) as (node, _):
        feed(node)
        assert "left_foot" in values(node)["limitations"] and "balance" in values(node)["limitations"]
    said = capfd.readouterr().err
    assert said.count("the skeleton has no joint left_foot; off: balance") == 1, said
    with node_in_this_process("/as_shipped") as (node, _):
        assert "limitations" not in values(node)


def test_the_floor_is_live():
    with node_in_this_process("/floor") as (node, _):
        feed(node, count=5)
        assert node._session.placement.camera_height is None
        (result,) = node.set_parameters([Parameter("floor", value=True)])
        assert not result.successful and "no frame is named" in result.reason
        for name, value in (("camera_height", 1.2), ("tilt_deviation", 0.02)):
            (result,) = node.set_parameters([Parameter(name, value=value)])
            assert result.successful, result.reason
        feed(node, 5, 5)
        assert (
            node._session.placement.camera_height == 1.2
            and values(node)["camera height above the floor [m]"] == "1.200"
        )


def test_the_state_follows_a_system_clock_that_is_set_back(monkeypatch):
    """As a robot's is when it finds its time server. Then the state is again lost only in silence."""
    with node_in_this_process("/set_back") as (node, _):
        now_ns = START_NS
        monkeypatch.setattr(node, "_now_ns", lambda: now_ns)
        node._inputs.camera_info.take(camera_info(BACKEND))
        for i in range(60):
            now_ns += PERIOD_NS if i != 30 else -60 * 10**9
            node.work_on(cloud(BACKEND, now_ns, PIXELS[i % FRAMES]), now_ns)
            node._update_presence()
            assert node._outputs.state == TRACKING or i in (30, 31)
        for _ in range(6):
            now_ns += 10**9
            node._update_presence()
        assert node._outputs.state == LOST


@pytest.mark.parametrize("shown", ["a person", "nobody"])
def test_messages_keep_their_ages_when_the_systems_clock_is_set_back(monkeypatch, shown):
    """Otherwise the state stands for as long as the clock was set back, if the detector has died."""
    with node_in_this_process("/dead", forget_after=0.5) as (node, _):
        now_ns, confidence = START_NS, [0.9 if shown == "a person" else 0.0] * 17
        monkeypatch.setattr(node, "_now_ns", lambda: now_ns)
        node._inputs.camera_info.take(camera_info(BACKEND))
        for i in range(5):
            now_ns += PERIOD_NS
            received_ns = now_ns
            if i == 4:
                now_ns -= 60 * 10**9  # while the last message waits
            node.work_on(cloud(BACKEND, START_NS + i * PERIOD_NS, PIXELS[i], confidence), received_ns=received_ns)
        states = []
        for period in range(20):
            now_ns += 10**8 if period != 10 else -9 * 10**8  # as old again as when the state was known
            node._update_presence()
            states.append(node._outputs.state)
        assert states[0] == (TRACKING if shown == "a person" else NOBODY) and set(states[6:]) == {LOST}, states
