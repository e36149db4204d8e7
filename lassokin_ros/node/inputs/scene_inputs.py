"""All inputs besides the keypoints: those of each camera, TF and the simulated time.

They are polled when they are needed, see `polled_subscription`. Missing ones are logged.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from rclpy.clock import ROSClock
from rclpy.node import Node

from lassokin_ros.node.inputs.camera_info_input import CameraInfoInput
from lassokin_ros.node.inputs.camera_inputs import CameraInputs
from lassokin_ros.node.inputs.camera_publishers import DuplicateNode
from lassokin_ros.node.inputs.missing_input import MissingInput
from lassokin_ros.node.inputs.polled_subscription import SimulatedTime
from lassokin_ros.node.inputs.transform_input import TransformInput
from lassokin_ros.node.log_throttle import LogThrottle
from lassokin_ros.pipeline.outputs import topics
from lassokin_ros.pipeline.outputs.diagnostics import Diagnostics
from lassokin_ros.pipeline.session import Session


class SceneInputs:
    """The subscriptions, and what is done with their messages."""

    def __init__(
        self,
        node: Node,
        session: Session,
        diagnostics: Diagnostics,
        on_depth: Callable[[str, Any], None],
        on_error: Callable[[str, Exception], None],
    ) -> None:
        """on_depth: called with the name of a camera and its depth image. on_error: called with a name of the message
        and the exception.

        Raises ConfigurationError if the package of a required message type is not installed.
        """
        self._node, self._session, self._on_error = node, session, on_error
        self._warning = LogThrottle(node.get_logger().warning, time.monotonic)
        self.simulated_time = SimulatedTime(node)
        self._cameras = {
            name: CameraInputs(node, session, images, diagnostics, on_depth, on_error)
            for name, images in session.cameras.items()
        }
        places = session.placement.places
        self._transforms = None if places is None else TransformInput(node, places)
        shared = session.config.detects_bodies  # the list of bodies has an absolute name
        self._duplicate = DuplicateNode(node, topics.REP155_TRACKED_OUTPUT.name if shared else topics.STATE)
        self._missing_clock = MissingInput(node, topics.CLOCK, topics.CLOCK_TYPE, (), time.monotonic())

    @property
    def camera_info(self) -> CameraInfoInput:
        """The camera_info of the first camera."""
        return next(iter(self._cameras.values())).camera_info

    def poll(self) -> None:
        """Process the messages received so far."""
        polled = [("a time", self.simulated_time.poll)]
        if self._transforms is not None:
            polled.append(("a TF message", self._transforms.poll))
        for what, poll in polled:
            try:
                poll()
            except Exception as error:  # the other inputs must still be polled
                self._on_error(what, error)
        for camera in self._cameras.values():
            camera.poll()

    def check(self, now: float) -> str:
        """Log missing inputs; now: s, steady clock. Call it periodically. Return faults in words."""
        clock, faults = self._node.get_clock(), []
        if isinstance(clock, ROSClock) and clock.ros_time_is_active:
            has_time = clock.now().nanoseconds > 0
            self._missing_clock.check(now, has_time)
            if not has_time:
                faults.append("use_sim_time is set, but no time was received on /clock")
        else:
            self._missing_clock.restart(now)
        faults += [camera.check(now) for camera in self._cameras.values()]
        if self._transforms is not None:
            fault = self._transforms.check(now)
            faults.append("" if self._session.placement.places else fault)  # /diagnostics has it for each camera
        faults.append(duplicate := self._duplicate.check(now))
        if duplicate:
            self._warning.log("duplicate_node", duplicate)
        return "; ".join(filter(None, faults))
