"""The ROS 2 node. A callback converts a message, tracks and publishes; the work is done by `session` and `core`."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType, JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.parameter import Parameter

from lassokin_ros.common.command_line import version
from lassokin_ros.core.evidence.evidence import Evidence
from lassokin_ros.node.inputs.keypoint_input import KeypointInput
from lassokin_ros.node.inputs.polled_subscription import ignore_events
from lassokin_ros.node.inputs.rep155_inputs import Rep155Inputs
from lassokin_ros.node.inputs.scene_inputs import SceneInputs
from lassokin_ros.node.message_types import message_class
from lassokin_ros.node.parameters import LiveParameters, Settings, changes_of, declare, unknown_parameters
from lassokin_ros.node.publishers import Publishers
from lassokin_ros.node.qos import sensor_data
from lassokin_ros.node.robot_state_publisher_client import RobotStatePublisherClient
from lassokin_ros.node.services import Services
from lassokin_ros.node.session_log import SessionLog
from lassokin_ros.pipeline.answers import Answer
from lassokin_ros.pipeline.outputs import topics
from lassokin_ros.pipeline.outputs.body_frames import Naming
from lassokin_ros.pipeline.outputs.diagnostics import Diagnostics
from lassokin_ros.pipeline.outputs.figures import averaged_sides
from lassokin_ros.pipeline.outputs.outputs import Outputs
from lassokin_ros.pipeline.parameter_files import NODE_NAME
from lassokin_ros.pipeline.people.people_tracker import FORGOTTEN
from lassokin_ros.pipeline.people.roster import GONE
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import ALL, OFF, NodeSettings
from msg_adapters.backends import RclpyBackend
from msg_adapters.output_messages.builders import DiagnosticArrayBuilder

DIAGNOSTICS_PERIOD_S = 1.0
SHORTEST_WAIT_NS = 1_000_000
"""ns: shortest period of the timer for images that wait."""
KEY_LENGTH = 20
"""Characters of a warning that identify it; numbers may follow."""
CHECK_PERIOD_S = 0.1
"""s: period of the check for people and cameras that have left. A departure is noticed within twice this time."""


class TrackerNode(Node):
    """Subscribes to keypoints and camera_info; publishes joint states, joints, translation, markers and diagnostics."""

    def __init__(self, node_name: str = NODE_NAME, evidence: Sequence[Evidence] = (), **options: Any) -> None:
        """evidence: the user's own, for each frame's lasso, see docs/extending.md. options: those of rclpy.node.Node
        (context, namespace, ...). Raises a LassokinError for a bad setting.
        """
        super().__init__(node_name, **options)
        settings = declare(self)
        self._live_parameters = LiveParameters(self, settings, self._tune)
        self._session = Session(*settings, evidence)
        self._log = SessionLog(self, self._session, bool(evidence))
        name = self.get_fully_qualified_name().lstrip("/")  # /diagnostics is shared by the trackers of all namespaces
        self._status = DiagnosticArrayBuilder(RclpyBackend())
        self._diagnostics = Diagnostics(self._session, name, time.monotonic())
        sink = Publishers(self)
        self._diagnostics_out = sink.open(topics.DIAGNOSTICS, topics.DIAGNOSTICS)
        self._open_outputs(settings[1], name, sink)
        self._listen(settings[1])
        for publisher in self.publishers:  # also those of rclpy; see `advertise`
            ignore_events(publisher)
        for line in unknown_parameters(self):
            self.get_logger().warning(line)
        self.get_logger().info(self._start_text())
        if self._session.tracker.averaged:
            self.get_logger().warning(averaged_sides(self._session.tracker.averaged))
        if self._session.tracker.limitations:
            self.get_logger().warning(self._session.tracker.limitations)

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """As in rclpy, but read-only parameters may be set to the value that they have."""
        changes = changes_of(self, parameter_list)
        if parameter_list and not changes:
            return SetParametersResult(successful=True)
        return super().set_parameters_atomically(changes)

    def _start_text(self) -> str:
        """Version, main settings, and the topics after remapping."""
        tracker, config = self._live_parameters.settings
        inputs = [topics.CAMERA_INFO] if self._bodies is not None else [topics.KEYPOINTS, topics.CAMERA_INFO]
        cameras = self._session.cameras
        found = [self.resolve_topic_name(topics.of_camera(topic, name)) for name in cameras for topic in inputs]
        names = ", ".join(found)
        outputs = self.resolve_topic_name(topics.JOINTS).rpartition("/")[0]
        if config.several_people:
            outputs = self.resolve_topic_name(topics.REP155_BODIES if config.rep155 else topics.BODIES) + "/<id>"
        return (
            f"lassokin_ros {version()}: height {tracker.height_text}, landmarks {tracker.landmarks}, reads {names}, "
            f"publishes {outputs}/..." + (f" in the frame '{config.fixed_frame}'" if config.fixed_frame else "")
        )

    def _open_outputs(self, config: NodeSettings, name: str, sink: Publishers) -> None:
        """Create the publishers of one person, or the common ones of several people."""
        if config.several_people and config.publish_tf != OFF:
            message_class(topics.TF.message_type)  # raises now, not when the first person appears
        self._outputs = Outputs(self._session, sink, RclpyBackend(), name)
        self._outputs.on_fault = partial(self._log.warning.log, "base_frame")
        self._outputs.on_state = self._log.state
        self._state_publisher = None
        if not config.several_people and config.publish_tf != ALL:
            self._state_publisher = RobotStatePublisherClient(self, Naming.of_person(config, name, "").prefix)
        if self._outputs.person is not None:
            if self._state_publisher is not None:
                self._outputs.person.described = self._state_publisher.describe
            self._outputs.person.describe_first()
        self._outputs.start(self._now_ns())

    def _listen(self, config: NodeSettings) -> None:
        """Create subscriptions, services, timers and the callback for clock jumps."""
        on_error = self._log.internal_error
        self._inputs = SceneInputs(self, self._session, self._diagnostics, self._on_depth, on_error)
        self._keypoints: list[KeypointInput] = []
        self._bodies: Rep155Inputs | None = None
        if config.topic_per_body:
            qos = sensor_data(config.queue_depth)
            self._bodies = Rep155Inputs(self, config.keypoints_type, qos, self._on_bodies, self._on_body)
        else:
            for name, camera in self._session.cameras.items():
                topic, process = topics.of_camera(topics.KEYPOINTS, name), partial(self.work_on, camera=name)
                self._keypoints.append(KeypointInput(self, topic, config, camera.counts, self._inputs.poll, process))
        self._as_of_ns = self._checked_ns = self._newest_ns = 0
        Services(self, self._session, self._forget, lambda: self._as_of_ns)
        steady = Clock(clock_type=ClockType.STEADY_TIME)  # diagnostics continue while simulated time is paused
        self._wait = self.create_timer(1e-9 * SHORTEST_WAIT_NS, self._on_wait_end, clock=steady)
        self._wait.cancel()
        self.create_timer(CHECK_PERIOD_S, self._update_presence, clock=steady)
        self.create_timer(DIAGNOSTICS_PERIOD_S, self._publish_diagnostics, clock=steady)
        jump = JumpThreshold(min_forward=None, min_backward=Duration(nanoseconds=-1), on_clock_change=True)
        self._jump_watch = self.get_clock().create_jump_callback(jump, post_callback=self._on_clock_jump)

    def _on_depth(self, camera: str, message: Any) -> None:
        now_ns = self._followed_clock_ns()
        self._answer("a depth image", partial(self._session.push_depth, message, now_ns, camera), now_ns)
        depth = self._session.cameras[camera].depth
        if depth is not None and depth.refusal:
            self._log.warning.log("depth", depth.refusal)

    def _on_wait_end(self) -> None:
        """Process images that have waited in vain. Simulated time may stand still."""
        self._wait.cancel()
        self._inputs.poll()  # TF, which may have come
        now_ns = self._followed_clock_ns()
        self._answer("images that waited", partial(self._session.due, now_ns), now_ns)

    def _on_bodies(self, ids: Sequence[str]) -> Sequence[str]:
        self._session.keep(ids)
        kept = self._session.roster.ids or []
        self._outputs.keep(kept, self._now_ns())
        return kept

    def _on_body(self, person: str, message: Any) -> None:
        self._inputs.poll()
        now_ns = self._followed_clock_ns()
        self._answer("a keypoint message", partial(self._session.push, message, now_ns, body=person), now_ns)

    def work_on(self, message: Any, received_ns: int = 0, camera: str = "") -> None:
        """Process one keypoint message and publish the answers. Never raises.

        received_ns: ns, system clock, 0 if the middleware gives none. camera: its name, empty for the only one.
        """
        now_ns = self._followed_clock_ns()
        arrival_ns = now_ns if self._clock_is_simulated else min(received_ns or now_ns, now_ns)
        self._answer("a keypoint message", partial(self._session.push, message, arrival_ns, camera), arrival_ns)

    def _answer(self, what: str, make: Callable[[], list[Answer]], arrival_ns: int) -> None:
        """Publish what the session answers. what: name of its input."""
        started = time.monotonic()
        try:
            answers = make()
            for answer in answers:
                self._outputs.publish(answer, arrival_ns, started)
                self._log.problems(answer.frames)
        except Exception as error:  # no message may end the node
            self._log.internal_error(what, error)
            return
        finally:
            self._await_due()
        ended = time.monotonic()
        for answer in answers:
            self._diagnostics.count_message(answer.frames, arrival_ns, ended, ended - started)

    def _await_due(self) -> None:
        """Set the timer to the end of the first wait, if anything waits."""
        due_ns = self._session.due_at_ns
        if due_ns is not None:
            self._wait.timer_period_ns = max(due_ns - self._now_ns(), SHORTEST_WAIT_NS)
            self._wait.reset()

    @property
    def _clock_is_simulated(self) -> bool:
        """Whether /clock gives the time. `ROSClock.ros_time_is_active` takes four times as long, see `Publishers`."""
        clock: Any = self.get_clock()  # a ROSClock, contrary to rclpy's type hints
        return bool(clock.handle.get_ros_time_override_is_enabled())

    def _now_ns(self) -> int:
        return int(self.get_clock().handle.get_now().nanoseconds)  # without a `Time`, which takes four times as long

    def _followed_clock_ns(self) -> int:
        """Return the node's time, ns. If the system's clock was set back, the messages keep their ages."""
        before_ns, self._newest_ns = self._newest_ns, self._now_ns()
        if self._newest_ns < before_ns:
            self._as_of_ns = self._checked_ns = self._newest_ns
            self._session.set_clock_back(before_ns - self._newest_ns)
            self._outputs.restart_clock()
        return self._newest_ns

    def _update_presence(self) -> None:
        """Poll the inputs, and update the list of people while no keypoints arrive (see `presence_at`).

        The time of the previous call is used: after a delay of the node itself, unread messages may be waiting.
        """
        self._inputs.poll()
        now_ns = self._followed_clock_ns()
        self._as_of_ns, self._checked_ns = self._checked_ns, now_ns
        ids = self._session.scene.presence_at(self._as_of_ns).ids
        if ids is not None:
            self._outputs.keep(ids, now_ns)
        self._session.scene.detector_connected = self._inputs_connected()
        self._outputs.check(self._as_of_ns)
        self._outputs.repeat(self._as_of_ns, time.monotonic())

    def _inputs_connected(self) -> bool:
        """Return True if each camera's detector publishes keypoints, or with one topic per body, the list of bodies."""
        if self._keypoints:
            return all(keypoints.publishers > 0 for keypoints in self._keypoints)
        return self._bodies is not None and self._bodies.publishers > 0

    def _publish_diagnostics(self) -> None:
        if self._bodies is not None:
            self._bodies.find_bodies()
        concerns = []
        if self._state_publisher is not None:
            self._state_publisher.update()
            concerns.append(self._state_publisher.fault)
        now, presence = time.monotonic(), self._session.scene.presence_at(self._as_of_ns)
        concerns.append(self._inputs.check(now))
        for keypoints, camera in zip(self._keypoints, self._session.cameras.values()):
            keypoints.check(now, camera.counts[camera.key("received")] > 0)
        concern = "; ".join(filter(None, concerns))
        line = self._diagnostics.line(now, presence, concern, self._outputs.state, self._as_of_ns)
        self._diagnostics_out.publish(self._status.fill(self._now_ns(), "", [line]))
        for words in self._diagnostics.inputs:
            self._log.warning.log(words[:KEY_LENGTH], words)

    def _on_clock_jump(self, jump: TimeJump) -> None:
        lock = ", and the lock has ended" if self._session.roster.locked is not None else ""
        self.get_logger().info(f"the clock has jumped: the state is forgotten{lock}")
        self._as_of_ns = self._checked_ns = self._newest_ns = 0
        if self._session.placement.transforms is not None:
            self._session.placement.transforms.clear()
        self._forget()

    def _forget(self) -> None:
        self._session.reset()
        self._outputs.forget(self._now_ns())  # the people who were tracked have left

    def _tune(self, settings: Settings) -> None:
        height = self._session.tracker.config.height
        self._session.tune(*settings)
        if settings[0].height != height:
            self._outputs.forget(self._now_ns())
            lock = f"; {FORGOTTEN}" if self._session.roster.locked == GONE else ""
            self.get_logger().info(f"height is now {settings[0].height_text}: the state is forgotten{lock}")
