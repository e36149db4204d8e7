"""Two trackers beside a robot with its own URDF, joint states and TF change none of them."""

import time
from itertools import count

import pytest

pytest.importorskip("rclpy")

from live import BACKEND, NodeProcess, Peer  # noqa: E402
from messages import FRAME, pixels_of_motion  # noqa: E402
from rclpy.node import Node  # noqa: E402
from rclpy.qos import DurabilityPolicy, QoSProfile  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402
from std_msgs.msg import String  # noqa: E402
from transforms import rpy, tf_message  # noqa: E402

from lassokin_ros.pipeline.outputs import topics  # noqa: E402
from lassokin_ros.pipeline.outputs.topics import STATE_PUBLISHER  # noqa: E402

URDF = '<robot name="arm"><link name="pelvis"/></robot>'
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
FRAME_NS = 33_000_000
"""Time between two frames of a test."""
SHARED = ("/diagnostics", "/parameter_events", "/rosout", "/tf")
"""Topics that every node may publish."""


def test_the_robots_topics_are_not_changed():
    pixels = pixels_of_motion(1)[0]
    with Peer("/one") as one, Peer("/two") as two:
        robot = Node("robot_state_publisher", context=one.context)
        robot.declare_parameter("robot_description", URDF)
        robot.create_publisher(String, "/robot_description", LATCHED).publish(String(data=URDF))
        robot.create_publisher(JointState, "/joint_states", 10)
        one.executor.add_node(robot)
        names = "/joint_states", "/robot_description", "/joints", "/markers", "/translation"
        asked = [
            f"{STATE_PUBLISHER}/{kind}_parameters:=/robot_state_publisher/{kind}_parameters" for kind in ("get", "set")
        ]
        with NodeProcess("/one", "-r", asked[0], "-r", asked[1]) as first, NodeProcess("/two"):
            described = {}
            for peer in (one, two):
                peer.listen(topics.ROBOT_DESCRIPTION)
                peer.start(pixels)
                texts = peer.got[topics.ROBOT_DESCRIPTION]
                peer.spin_until(lambda: texts and FRAME in texts[-1].data, what="its description")  # noqa: B023
                described[peer] = texts[-1].data
            one.next_diagnostics(lambda s: "is not changed" in s.message)
            publishers = [one.node.get_publishers_info_by_topic(name) for name in names]
            assert [[p.node_name for p in found] for found in publishers[:2]] == [["robot_state_publisher"]] * 2
            assert not any(publishers[2:])
            assert robot.get_parameter("robot_description").value == URDF
            for namespace in ("/one", "/two"):
                own = []

                def found(namespace=namespace, own=own):
                    try:
                        there = one.node.get_publisher_names_and_types_by_node("tracker", namespace)
                    except Exception:  # rclpy's NodeNameNonExistentError until the node is discovered
                        return False
                    own[:] = [name for name, _ in there if name not in SHARED]
                    return own

                one.spin_until(found, what="the tracker's publishers")
                assert own and all(name.startswith(f"{namespace}/tracker/") for name in own)
        links = [{part.split('"')[0] for part in text.split('link name="')[1:]} for text in described.values()]
        assert links[0] & links[1] <= {FRAME} and not {"pelvis"} & (links[0] | links[1])
        one.executor.remove_node(robot)
        robot.destroy_node()
    assert first.said.count("is not of this node") == 1


def test_no_frame_of_the_robots_gets_another_parent_or_name():
    """TF of a robot whose frames have the names of the body's joints, beside two trackers that publish all frames."""
    pytest.importorskip("tf2_msgs", reason="tf2_msgs is not installed: apt, or `make messages`")
    from tf2_msgs.msg import TFMessage

    of_robot = {"pelvis": "base_link", "head": "pelvis", "left_hand": "pelvis", "body": "base_link", FRAME: "head"}
    pixels, transforms = pixels_of_motion(40), []
    with Peer("/one", outputs=False) as one, Peer("/two", outputs=False) as two:
        one.node.create_subscription(TFMessage, "/tf", lambda m: transforms.extend(m.transforms), 100)
        one.node.create_subscription(TFMessage, "/tf_static", lambda m: transforms.extend(m.transforms), LATCHED)
        static = one.node.create_publisher(TFMessage, "/tf_static", LATCHED)
        static.publish(tf_message(BACKEND, 0, *((parent, child, rpy(0, 0)) for child, parent in of_robot.items())))
        settings = "-p", "publish_tf:=all", "-p", "fixed_frame:=base_link"
        with NodeProcess("/one", *settings), NodeProcess("/two", *settings, "-p", "max_people:=2"):
            seen, stamps, next_at = set(), count(one.start_ns, FRAME_NS), 0.0

            def both():
                nonlocal next_at
                if time.monotonic() >= next_at:  # as fast as a camera: a node would miss frames that are sent faster
                    stamp_ns, next_at = next(stamps), time.monotonic() + 1e-9 * FRAME_NS
                    for peer in (one, two):
                        peer.send_camera()
                        # Of repeated keypoints a node publishes nothing after a second; that may be before it is found.
                        peer.send(stamp_ns, pixels[stamp_ns // FRAME_NS % len(pixels)])
                two.executor.spin_once(timeout_sec=0.0)
                seen.update(transform.child_frame_id.partition("/")[0] for transform in transforms)
                return {"one", "two"} <= seen

            one.spin_until(both, what="the frames of both trackers")
            publishers = {info.node_name for info in one.node.get_publishers_info_by_topic("/tf_static")}
    parents = {}
    for transform in transforms:
        parents.setdefault(transform.child_frame_id, set()).add(transform.header.frame_id)
    assert all(len(found) == 1 for found in parents.values()), parents
    assert {child: found for child, found in parents.items() if "/" not in child} == {
        child: {parent} for child, parent in of_robot.items()
    }
    ours = [name for name in parents if "/" in name]
    assert len(ours) == 50 and all(name.startswith(("one/tracker/", "two/tracker/p1/")) for name in ours)
    assert publishers == {"peer"}  # the trackers publish no static frames
