"""robot_state_publisher's URDF follows ~/robot_description, on real DDS. A node with the same parameter replaces it."""

from contextlib import ExitStack

import pytest

pytest.importorskip("rclpy")

from live import NodeProcess, Peer, complaints  # noqa: E402
from messages import FRAME, pixels_of_motion  # noqa: E402
from rcl_interfaces.msg import SetParametersResult  # noqa: E402
from rclpy.node import Node  # noqa: E402

from lassokin_ros.core.body.skeleton import Skeleton  # noqa: E402
from lassokin_ros.pipeline.outputs.topics import STATE_PUBLISHER  # noqa: E402
from lassokin_ros.pipeline.outputs.urdf import urdf  # noqa: E402

SKELETON = Skeleton.load("anthropometric", 1.75)
SETTINGS = ("-p", "height:=1.75")


def own_urdf(peer, base_frame):
    return urdf(SKELETON, base_frame, f"{peer.namespace[1:]}/tracker/")


class StandIn:
    """A node named human_state_publisher. It refuses a URDF that contains `bad`."""

    def __init__(self, peer, bad="<nothing>", text=None):
        self.peer, self.asked = peer, []
        self.node = Node(STATE_PUBLISHER, namespace=peer.namespace, context=peer.context)
        self.node.declare_parameter("robot_description", text or own_urdf(peer, "launch_frame"))

        def check(parameters):
            self.asked.append(parameters[0].value)
            return SetParametersResult(successful=bad not in self.asked[-1], reason="it is bad")

        self.node.add_on_set_parameters_callback(check)
        peer.executor.add_node(self.node)

    @property
    def urdf(self):
        return self.node.get_parameter("robot_description").value

    def end(self):
        self.peer.executor.remove_node(self.node)
        self.node.destroy_node()


def test_the_urdf_follows_the_frame_and_a_restart():
    namespace, pixels = "/followed", pixels_of_motion(2)
    with NodeProcess(namespace, *SETTINGS) as node, Peer(namespace) as peer:
        peer.next_diagnostics()  # the tracker starts first
        other = StandIn(peer)
        peer.spin_until(lambda: other.urdf == own_urdf(peer, "camera_optical_frame"), what="the first description")
        peer.start(pixels[0])
        peer.spin_until(lambda: other.urdf == own_urdf(peer, FRAME), what="the camera's frame")
        assert len(other.asked) == 2
        other.end()
        peer.next_diagnostics()
        peer.next_diagnostics()
        again = StandIn(peer)
        peer.spin_until(lambda: again.urdf == own_urdf(peer, FRAME), what="the description after a restart")
        again.end()
    assert not complaints(node.said)


def test_a_refusal_is_logged_once_and_has_no_other_effect():
    namespace, pixels = "/refused", pixels_of_motion(2)
    with NodeProcess(namespace, *SETTINGS) as node, Peer(namespace) as peer:
        other = StandIn(peer, bad=FRAME)
        peer.start(pixels[0])
        peer.spin_until(lambda: any(FRAME in text for text in other.asked), what="the description")
        for _ in range(3):
            peer.next_diagnostics()
        assert sum(FRAME in text for text in other.asked) == 1
    assert node.said.count("refused robot_description: it is bad") == 1 and "Traceback" not in node.said


def test_the_urdf_of_a_robot_is_never_changed():
    """Neither that of a robot, nor that of another tracker, whose links have another prefix."""
    robots = {
        "/arm": '<robot name="arm"><link name="base_link"/></robot>',
        "/empty": "no URDF",
        "/other_tracker": urdf(SKELETON, FRAME, "other/tracker/"),
    }
    with ExitStack() as stack:
        nodes = {namespace: stack.enter_context(NodeProcess(namespace, *SETTINGS)) for namespace in robots}
        for namespace, text in robots.items():
            with Peer(namespace) as peer:
                robot = StandIn(peer, text=text)
                peer.start(pixels_of_motion(2)[0])
                peer.next_diagnostics(lambda s: "is not changed" in s.message)
                assert robot.urdf == text and not robot.asked
                robot.end()
    assert [node.said.count("is not of this node") for node in nodes.values()] == [1, 1, 1]
