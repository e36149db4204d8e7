"""Client of a robot_state_publisher: sets its URDF to ~/robot_description, so that its TF has the calibrated lengths.

robot_state_publisher of Jazzy reads its URDF only from its parameter robot_description, which can be set while it runs.
The node looks for the one with the name STATE_PUBLISHER in its namespace, as tracker.launch.py starts it, and sets the
URDF only if the present value is one of this node. It never replaces the URDF of a robot.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.node import Node
from rclpy.task import Future

from lassokin_ros.pipeline.outputs.topics import STATE_PUBLISHER
from lassokin_ros.pipeline.outputs.urdf import has_prefix

PARAMETER = "robot_description"
RESPONSE_TIMEOUT_S = 5.0
"""s: an unanswered request is abandoned after this time and sent again."""


class RobotStatePublisherClient:
    """Sets the parameter of the other node when the URDF changes. No call blocks."""

    def __init__(self, node: Node, prefix: str) -> None:
        """prefix: of the links in this node's URDF."""
        self._node, self._prefix = node, prefix
        self._clients: tuple[Any, Any] | None = None  # which get and set; none before the other node is there
        self._text = self._sent = self._refused = ""
        self._request: tuple[Any, Future, float] | None = None
        self.fault = ""
        """Why the other node's URDF is not changed, in words; empty if it is, or if there is no such node."""

    def describe(self, text: str) -> None:
        """Set a new URDF."""
        self._text = text
        self.update()

    def update(self) -> None:
        """Send the URDF if the other node runs and has an older one. Call this periodically."""
        if self._clients is None:
            if not self._node.count_services(self._node.resolve_service_name(f"{STATE_PUBLISHER}/set_parameters")):
                return
            self._clients = (
                self._node.create_client(GetParameters, f"{STATE_PUBLISHER}/get_parameters"),
                self._node.create_client(SetParameters, f"{STATE_PUBLISHER}/set_parameters"),
            )
        if not all(client.service_is_ready() for client in self._clients):
            self._sent = self.fault = ""  # the other node restarts with its own value
        elif not self._is_waiting() and self._text not in (self._sent, self._refused):
            self._call(self._clients[0], GetParameters.Request(names=[PARAMETER]), self._on_present)

    def _is_waiting(self) -> bool:
        """True while a request is unanswered; an old one is abandoned."""
        if self._request is None:
            return False
        client, future, sent_at = self._request
        if time.monotonic() - sent_at < RESPONSE_TIMEOUT_S:
            return True
        client.remove_pending_request(future)
        self._request = None
        return False

    def _call(self, client: Any, request: Any, on_response: Callable[[Any], None]) -> None:
        future = client.call_async(request)
        self._request = client, future, time.monotonic()

        def finish(done: Future) -> None:
            self._request = None
            on_response(done.result())

        future.add_done_callback(finish)

    def _on_present(self, response: Any) -> None:
        """Set the URDF if the present one is of this node."""
        present = response.values[0].string_value if response.values else ""
        if not has_prefix(present, self._prefix):
            self._report(
                f"the robot_description of {STATE_PUBLISHER} is not of this node (no links '{self._prefix}...'): it is "
                "not changed; give this name only to the robot_state_publisher of the human, as tracker.launch.py does"
            )
            return
        text = self._text
        if present == text:
            self._sent, self.fault = text, ""
            return
        assert self._clients is not None
        value = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=text)
        request = SetParameters.Request(parameters=[Parameter(name=PARAMETER, value=value)])
        self._call(self._clients[1], request, lambda response: self._on_set(response, text))

    def _on_set(self, response: Any, text: str) -> None:
        (result,) = response.results
        if result.successful:
            self._sent, self._refused, self.fault = text, "", ""
        else:
            self._refused = text
            self._node.get_logger().warning(f"{STATE_PUBLISHER} refused robot_description: {result.reason}")
        if self._text != text:
            self.update()

    def _report(self, fault: str) -> None:
        """Log a fault when it begins, and keep it for the diagnostics."""
        if fault != self.fault:
            self._node.get_logger().warning(fault)
        self.fault = fault
