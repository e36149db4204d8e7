"""The services of the node."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from lassokin_ros.core.errors import LassokinError
from lassokin_ros.pipeline.outputs.saved_files import save_all, save_cameras
from lassokin_ros.pipeline.session import Session


class Services:
    """~/reset, ~/set_enabled, ~/lock, ~/save_skeleton and ~/save_cameras."""

    def __init__(self, node: Node, session: Session, forget: Callable[[], None], as_of_ns: Callable[[], int]) -> None:
        """forget: resets the session and its outputs. as_of_ns: returns the time up to which all messages were read."""
        self._node, self._session, self._forget, self._as_of_ns = node, session, forget, as_of_ns
        node.create_service(Trigger, "~/reset", self._on_reset)
        node.create_service(SetBool, "~/set_enabled", self._on_set_enabled)
        node.create_service(SetBool, "~/lock", self._on_lock)
        node.create_service(Trigger, "~/save_skeleton", self._on_save_skeleton)
        node.create_service(Trigger, "~/save_cameras", self._on_save_cameras)

    def _on_reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._forget()
        self._node.get_logger().info("reset: the state is forgotten")
        response.success, response.message = True, "state forgotten; the next usable frame initialises anew"
        return response

    def _on_set_enabled(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        """A disabled node keeps its topics and its camera, forgets all people, and needs almost no time."""
        changed = self._session.enabled is not request.data
        self._session.enabled = request.data
        if changed:
            self._forget()
            self._node.get_logger().info("enabled" if request.data else "disabled")
        response.success = True
        response.message = ("enabled" if request.data else "disabled") + ("" if changed else " already")
        return response

    def _on_lock(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        """Lock the person whom the parameter `follow` names, or release the lock."""
        try:
            if request.data:
                response.success, response.message = True, f"locked: {self._session.lock(self._as_of_ns())}"
            else:
                self._session.roster.hold(None)
                response.success, response.message = True, "nobody is locked"
            self._node.get_logger().info(response.message)
        except LassokinError as error:
            response.success, response.message = False, str(error)
        return response

    def _on_save_skeleton(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        path = self._file("skeleton.yaml")
        return _written(
            response,
            lambda: save_all(self._session.roster.calibrations(), path, self._node.get_clock().now().nanoseconds),
        )

    def _on_save_cameras(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        return _written(response, lambda: [save_cameras(self._session, self._file("cameras.sh"))])

    def _file(self, ending: str) -> Path:
        """Return where the answer of a service is written."""
        return Path(f"~/.ros/{self._node.get_fully_qualified_name()[1:].replace('/', '_')}_{ending}")


def _written(response: Trigger.Response, write: Callable[[], Sequence[Path]]) -> Trigger.Response:
    """Answer a service that writes files."""
    try:
        response.success, response.message = True, f"written: {', '.join(str(path.absolute()) for path in write())}"
    except LassokinError as error:
        response.success, response.message = False, str(error)
    return response
