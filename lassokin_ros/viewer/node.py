"""The node `viewer`: image, keypoints and the outputs of each tracked person in the viewer Rerun."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_msgs.msg import String

from lassokin_ros.common.atomic_files import AtomicFiles
from lassokin_ros.core.body.roles import STANDING_HEIGHT
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.errors import LassokinError
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.observation import Status
from lassokin_ros.node.log_throttle import LogThrottle
from lassokin_ros.node.message_types import message_class
from lassokin_ros.node.qos import sensor_data
from lassokin_ros.pipeline.camera.lens import Lens
from lassokin_ros.pipeline.outputs import topics
from lassokin_ros.skeleton_readers import urdf
from lassokin_ros.video.rerun_scene import REPROJECTION, RerunScene, ViewError
from msg_adapters.camera_info import decode_camera_info
from msg_adapters.detectors import point_cloud2
from msg_adapters.errors import AdapterError
from msg_adapters.image import decode_image
from msg_adapters.keypoints import stamp_of
from msg_adapters.output_messages.clouds import read_uncertainty_cloud

TIMELINE = "stamp"
DEPTH = 10
"""Messages that wait for being shown."""
ERROR_KEY = "reprojection error [px]"
"""Key of the reprojection error in ~/certificate."""


class PersonTopics:
    """Subscribes to the outputs of one person and logs them. A message that cannot be shown raises AdapterError."""

    def __init__(self, viewer: ViewerNode, person: str) -> None:
        """person: the id, empty if one person is followed."""
        self._viewer, self._scene = viewer, viewer.scene
        self._place = f"/{person}" if person else ""
        self._skeleton: Skeleton | None = None
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        types = {topic.name: message_class(topic.message_type) for topic in topics.PERSON_OUTPUTS}
        self._subscriptions = [
            viewer.create_subscription(
                types[name], viewer.topic_of(topics.of_person(name, person)), viewer.showing(log), qos
            )
            for name, log, qos in (
                (topics.ROBOT_DESCRIPTION, self._on_description, latched),
                (topics.JOINTS, self._on_joints, sensor_data(DEPTH)),
                (topics.JOINT_UNCERTAINTY, self._on_uncertainty, sensor_data(DEPTH)),
                (topics.CERTIFICATE, self._on_certificate, sensor_data(DEPTH)),
            )
        ]

    def _on_description(self, message: Any) -> None:
        """Store joint names and tree. Raises SkeletonError."""
        skeleton = urdf.parse(message.data, "robot_description", height=1.0)
        self._skeleton = replace(skeleton, height=_height(skeleton))

    def _on_joints(self, message: Any) -> None:
        skeleton = self._skeleton
        if skeleton is None:
            raise AdapterError("no_description", "joints are shown when ~/robot_description has arrived")
        poses = [(p.position, p.orientation) for p in message.poses]
        if len(poses) != skeleton.joint_count:
            raise AdapterError(
                "wrong_shape", f"{len(poses)} joints; robot_description has {skeleton.joint_count} joints"
            )
        joints = np.array([(p.x, p.y, p.z) for p, _ in poses])
        turns = Rotation.from_quat([(q.x, q.y, q.z, q.w) for _, q in poses])
        parents = np.maximum(skeleton.parents, 0)
        relative = (turns[parents].inv() * turns).as_matrix()
        self._scene.add_skeleton(self._place, skeleton, joints)
        lens = self._viewer.lens
        if self._viewer.is_of_camera(message.header.frame_id) and lens is not None:  # it cannot be projected elsewhere
            self._scene.add_outline(self._place, skeleton, lens.distort(project(joints)))
        self._scene.add_angles(self._place, skeleton, relative)

    def _on_uncertainty(self, message: Any) -> None:
        self._scene.add_uncertainty(self._place, *read_uncertainty_cloud(message))

    def _on_certificate(self, message: Any) -> None:
        values = {pair.key: pair.value for status in message.status for pair in status.values}
        if ERROR_KEY in values:
            self._scene.add_error(self._place, REPROJECTION, float(values[ERROR_KEY]))

    def clear(self) -> None:
        """Remove the person from the view."""
        self._scene.clear(self._place)

    def close(self) -> None:
        """End the subscriptions, and remove the person from the view."""
        for subscription in self._subscriptions:
            self._viewer.destroy_subscription(subscription)
        self.clear()


def _height(skeleton: Skeleton) -> float:
    """Return the person's height, m, by the joints of head and ankles at rest; 1.75 for a skeleton without them."""
    names, heights = skeleton.joint_names, skeleton.rest_positions[:, 1]
    if not {"head", "left_ankle"} <= set(names):
        return 1.75
    rise = heights[names.index("head")] - heights[names.index("left_ankle")]
    return float(rise / (STANDING_HEIGHT["head"] - STANDING_HEIGHT["left_ankle"]))


class ViewerNode(Node):
    """Logs the messages at their stamps. A message that cannot be shown is left out and reported in the log."""

    def __init__(self, path: Path | None, replace: bool, node_name: str = "viewer", **options: Any) -> None:
        """path: of the recording (.rrd), None opens a window. replace: an existing file may be replaced.

        options: of rclpy's Node. Raises ViewError.
        """
        option = "the viewer" if path is None else "viewer --save"
        self._files = AtomicFiles(replace, ViewError)
        self.scene = RerunScene(path, "lassokin viewer", option, self._files, TIMELINE)
        super().__init__(node_name, **options)
        description = ParameterDescriptor(description="name of the tracker's node", read_only=True)
        self._tracker = str(self.declare_parameter("tracker", "tracker", description).value)
        description = ParameterDescriptor(description="the tracker's parameter of this name", read_only=True)
        self._rectified = bool(self.declare_parameter("rectified", False, description).value)
        self._warning = LogThrottle(self.get_logger().warning, time.monotonic)
        self._camera: tuple[Any, ...] = ()
        self.lens: Lens | None = None
        self._frames: set[str] = set()
        self._z_up = False
        self._people = {"": PersonTopics(self, "")}
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.create_subscription(Image, "image_raw", self.showing(self._on_image), sensor_data(1))
        self.create_subscription(CameraInfo, topics.CAMERA_INFO, self.showing(self._on_camera), sensor_data(DEPTH))
        self.create_subscription(PointCloud2, topics.KEYPOINTS, self.showing(self._on_keypoints), sensor_data(DEPTH))
        self.create_subscription(String, self.topic_of(topics.STATE), self.showing(self._on_state), latched)
        tracked = self.topic_of(topics.TRACKED_OUTPUT.name)
        self.create_subscription(String, tracked, self.showing(self._on_tracked), latched)
        where = "in a window" if path is None else f"in '{path}', which is complete when this node ends"
        self.get_logger().info(f"shows the topics of '{self._tracker}' {where}")

    def topic_of(self, name: str) -> str:
        """Return the name of a tracker's topic, relative to this node's namespace as the tracker's name is."""
        return name.replace("~", self._tracker)

    def is_of_camera(self, frame_id: str) -> bool:
        """Return whether a skeleton's frame is that of camera or keypoints. Another one is fixed, and has z up."""
        own = not self._frames or not frame_id or frame_id.lstrip("/") in self._frames
        if self._z_up == own:
            self._z_up = not own
            self.scene.set_axes(self._z_up)
            if self._z_up:
                self.get_logger().info(f"the skeleton is in '{frame_id}': it is shown in 3D, and not in the image")
        return own

    def showing(self, log: Callable[[Any], None]) -> Callable[[Any], None]:
        """Return the callback that logs a message at its stamp, and reports a message that cannot be shown."""
        return partial(self._log, log)

    def _log(self, log: Callable[[Any], None], message: Any) -> None:
        stamp_ns = stamp_of(message)
        if stamp_ns is not None:
            self.scene.set_time(timestamp=np.datetime64(stamp_ns, "ns"))
        try:
            log(message)
        except AdapterError as error:
            self._warning.log(error.reason, f"not shown ({error.reason}): {error}")
        except LassokinError as error:
            self._warning.log(type(error).__name__, f"not shown: {error}")
        except Exception as error:
            if self.context.ok():
                self._warning.log("internal_error", f"not shown: {type(error).__name__}: {error}")

    def _on_camera(self, message: CameraInfo) -> None:
        camera = decode_camera_info(message, self._rectified)
        self._frames.add(message.header.frame_id.lstrip("/"))  # as the tracker's outputs have it
        key = (camera.K.tobytes(), camera.D.tobytes(), camera.model, camera.width, camera.height)
        if key == self._camera:
            return
        self.lens = Lens.from_intrinsics(camera, self._rectified)
        if camera.width > 0 and camera.height > 0:
            self.scene.set_camera(camera.K, (camera.width, camera.height))
        self._camera = key

    def _on_image(self, message: Image) -> None:
        self.scene.add_image(decode_image(message))

    def _on_keypoints(self, message: PointCloud2) -> None:
        keypoints = point_cloud2.decode(message)
        self._frames.add(message.header.frame_id.lstrip("/"))  # as the tracker's outputs have it
        self.scene.add_keypoints("", keypoints.xy[keypoints.present])

    def _on_state(self, message: String) -> None:
        if message.data != Status.TRACKING.value:
            for person in self._people.values():
                person.clear()

    def _on_tracked(self, message: String) -> None:
        """Subscribe to the topics of people who appear, and remove those who leave."""
        present = {"", *filter(None, message.data.split(","))}
        for person in self._people.keys() - present:
            self._people.pop(person).close()
        for person in present - self._people.keys():
            self._people[person] = PersonTopics(self, person)

    def destroy_node(self) -> None:
        """Complete the recording, too."""
        try:
            with self._files:
                self.scene.finish()
        except ViewError as error:
            self.get_logger().error(str(error))
        super().destroy_node()
