"""Client of a robot_state_publisher: sets its URDF to ~/robot_description, so that its TF has the calibrated lengths.

robot_state_publisher of Jazzy reads its URDF only from its parameter robot_description, which can be set while it runs.
The node sets it only if its present value is a URDF of this node. It never replaces the URDF of a robot.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.exceptions import InvalidServiceNameException
from rclpy.node import Node
from rclpy.task import Future

from lassokin_ros.core.errors import ConfigurationError
from lassokin_ros.pipeline.outputs.description.urdf import has_prefix

PARAMETER = "robot_description"
RESPONSE_TIMEOUT_S = 5.0
"""s: an unanswered request is abandoned after this time and sent again."""
START_TIMEOUT_S = 5.0
"""s: the other node may need this long to start."""


class RobotStatePublisherClient:
    """Sets the parameter of the other node when the URDF changes. No call blocks."""

    def __init__(self, node: Node, name: str, prefix: str) -> None:
        """name: of the other node, relative to the namespace; prefix: of the links in this node's URDF.

        Raises ConfigurationError if `name` is not a node name.
        """
        self._node, self._name, self._prefix = node, name, prefix
        try:
            self._get = node.create_client(GetParameters, f"{name}/get_parameters")
            self._set = node.create_client(SetParameters, f"{name}/set_parameters")
        except InvalidServiceNameException:
            raise ConfigurationError(
                f"state_publisher is '{name}'; expected the name of a node, such as human_state_publisher: letters, "
                "digits and _, no digit first"
            ) from None
        self._text = self._sent = self._refused = ""
        self._request: tuple[Any, Future, float] | None = None
        self._seen_at = time.monotonic()
        self.fault = ""
        """Why the other node's URDF is not up to date, in words; empty if it is, or if the node may still start."""

    def describe(self, text: str) -> None:
        """Set a new URDF."""
        self._text = text
        self.update()

    def update(self) -> None:
        """Send the URDF if the other node runs and has an older one. Call this periodically."""
        if not (self._get.service_is_ready() and self._set.service_is_ready()):
            self._sent = ""  # the other node restarts with its own value
            self._check_absence()
            return
        self._seen_at = time.monotonic()
        if self._is_waiting() or self._text in (self._sent, self._refused):
            return
        self._call(self._get, GetParameters.Request(names=[PARAMETER]), self._on_present)

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
                f"state_publisher is '{self._name}', whose robot_description is not of this node (no links "
                f"'{self._prefix}...'): it is not changed. Name the robot_state_publisher of the human, as "
                "tracker.launch.py starts it"
            )
            return
        text = self._text
        if present == text:
            self._sent, self.fault = text, ""
            return
        value = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=text)
        request = SetParameters.Request(parameters=[Parameter(name=PARAMETER, value=value)])
        self._call(self._set, request, lambda response: self._on_set(response, text))

    def _on_set(self, response: Any, text: str) -> None:
        (result,) = response.results
        if result.successful:
            self._sent, self._refused, self.fault = text, "", ""
        else:
            self._refused = text
            self._node.get_logger().warning(f"{self._name} refused robot_description: {result.reason}")
        if self._text != text:
            self.update()

    def _check_absence(self) -> None:
        if time.monotonic() - self._seen_at >= START_TIMEOUT_S:
            self._report(
                f"state_publisher is '{self._name}', but there is no service {self._set.service_name}: its URDF is not "
                "updated. Check that the node runs and has this name"
            )

    def _report(self, fault: str) -> None:
        """Log a fault when it begins, and keep it for the diagnostics."""
        if fault != self.fault:
            self._node.get_logger().warning(fault)
        self.fault = fault
