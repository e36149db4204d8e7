"""Several publishers of camera_info are named: at once if their messages differ."""

import time
from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy", reason="the ROS client library is not installed")

from live import NodeProcess, Peer  # noqa: E402
from messages import camera_info, pixels_of_motion  # noqa: E402

from lassokin_ros.node.inputs.camera_publishers import LEFTOVER_S, CameraPublishers  # noqa: E402
from msg_adapters.backends import RclpyBackend  # noqa: E402
from msg_adapters.output_messages.builders import WARN  # noqa: E402


def watch(*names):
    """A watch of a topic with these publishers; the list can be changed."""
    found = [SimpleNamespace(node_namespace="/robot", node_name=name) for name in names]
    node = SimpleNamespace(resolve_topic_name=lambda name: f"/{name}", get_publishers_info_by_topic=lambda _: found)
    return CameraPublishers(node, "camera_info"), found


def test_one_publisher_is_no_warning():
    assert watch("driver")[0].check(100.0, True) == watch()[0].check(100.0, True) == ""
    watched, found = watch("driver")
    assert watched.count == 0 and watched.check(0.0, False) == "" and watched.count == 1
    found.append(found[0])
    watched.check(0.0, False)
    assert watched.count == 2


def test_two_publishers_of_different_cameras_are_named_at_once():
    watched, _ = watch("left", "right")
    text = watched.check(0.0, True)
    assert (
        text == "/camera_info has 2 publishers: /robot/left, /robot/right; expected that of the keypoints' camera alone"
    )


def test_two_publishers_of_one_camera_are_named_after_a_while():
    watched, found = watch("driver", "relay")
    assert watched.check(0.0, False) == watched.check(LEFTOVER_S - 1, False) == ""
    assert "2 publishers" in watched.check(LEFTOVER_S, False)
    other = found.pop()
    assert watched.check(LEFTOVER_S + 1, False) == ""
    found.append(other)
    assert watched.check(LEFTOVER_S + 2, False) == ""


def test_a_list_of_many_is_cut():
    watched, _ = watch(*"abcdef")
    text = watched.check(0.0, True)
    assert watched.count == 6
    assert "6 publishers: /robot/a, /robot/b, /robot/c, /robot/d, ...;" in text


def test_two_cameras_on_one_topic_of_a_real_node():
    backend, pixels = RclpyBackend(), pixels_of_motion(60)
    with NodeProcess("/two") as _, Peer("/two") as peer:
        other = peer.node.create_publisher(type(camera_info(backend)), "camera_info", 10)
        peer.start(pixels[0])
        deadline, i = time.monotonic() + 20.0, 0
        while time.monotonic() < deadline:
            i += 1
            peer.send_camera()
            other.publish(camera_info(backend, 400.0))
            peer.send(peer.start_ns + i * 33_333_333, pixels[i % 60])
            peer.executor.spin_once(timeout_sec=0.03)
            said = [d.status[0] for d in peer.got["/diagnostics"]] if peer.got.get("/diagnostics") else []
            if any("camera_info of two cameras" in s.message and "2 publishers" in s.message for s in said):
                break
        else:
            raise AssertionError([s.message for s in said][-3:])
        assert said[-1].level == bytes([WARN]) or said[-1].level == WARN
