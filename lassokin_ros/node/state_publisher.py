"""Keeps robot_state_publisher's URDF the same as ours: its TF then follows calibration and the camera's frame.

robot_state_publisher of Jazzy takes its URDF from its parameter robot_description alone, which may be set while it
runs.
"""

from __future__ import annotations

import time
from typing import Any

from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.exceptions import InvalidServiceNameException
from rclpy.node import Node
from rclpy.task import Future

from lassokin_ros.core.errors import ConfigurationError

PATIENCE_S = 5.0
"""s: after this an unanswered request is given up, and made again."""


ABSENT_S = 5.0
"""s: a node that is started together with this one may take so long."""


class StatePublisher:
    """Sets the other node's parameter when it has to change; nothing waits for it."""

    def __init__(self, node: Node, name: str) -> None:
        """name: of robot_state_publisher, relative to the node's namespace. ConfigurationError for what is no name."""
        self._node, self._name = node, name
        try:
            self._client = node.create_client(SetParameters, f"{name}/set_parameters")
        except InvalidServiceNameException:
            raise ConfigurationError(
                f"state_publisher is '{name}'; expected the name of a node, such as robot_state_publisher: letters, "
                "digits and _, no digit first"
            ) from None
        self._text = self._known = self._refused = ""
        self._asked: tuple[Future, float] | None = None
        self._there_at, self._warned = time.monotonic(), False
        self.fault = ""
        """Why the other node's URDF does not follow, in words; empty while it is there, or has not been away long."""

    def describe(self, text: str) -> None:
        """Here is another URDF."""
        self._text = text
        self.push()

    def push(self) -> None:
        """Send what the other node does not know yet, if it is there; call it again from time to time."""
        if not self._client.service_is_ready():
            self._known = ""  # it may come back as it was at its start
            self._miss()
            return
        self._there_at, self.fault = time.monotonic(), ""
        if self._asked is not None:
            if time.monotonic() - self._asked[1] < PATIENCE_S:
                return
            self._client.remove_pending_request(self._asked[0])
            self._asked = None
        if self._text in (self._known, self._refused):
            return
        text = self._text
        value = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=text)
        request = SetParameters.Request(parameters=[Parameter(name="robot_description", value=value)])
        future = self._client.call_async(request)
        self._asked = future, time.monotonic()
        future.add_done_callback(lambda done: self._answered(done, text))

    def _miss(self) -> None:
        """Say once, and from then on in `fault`, that the other node is not there."""
        if time.monotonic() - self._there_at < ABSENT_S:
            return
        self.fault = (
            f"state_publisher is '{self._name}', but there is no service {self._client.service_name}, so that its URDF "
            "does not follow: is that node running, and is this its name?"
        )
        if not self._warned:
            self._warned = True
            self._node.get_logger().warning(self.fault)

    def _answered(self, future: Any, text: str) -> None:
        self._asked = None
        (result,) = future.result().results
        if result.successful:
            self._known, self._refused = text, ""
        else:
            self._refused = text
            self._node.get_logger().warning(f"{self._name} refused our robot_description: {result.reason}")
        self.push()
