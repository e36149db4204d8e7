"""The topics of one tracked person, and how they are logged."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from scipy.spatial.transform import Rotation

from lassokin_ros.core.body.roles import STANDING_HEIGHT
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.image.projection import project
from lassokin_ros.node.message_types import message_class
from lassokin_ros.node.qos import sensor_data
from lassokin_ros.pipeline.camera.lens import Lens
from lassokin_ros.pipeline.outputs import topics
from lassokin_ros.skeleton_readers import urdf
from lassokin_ros.video.rerun_scene import REPROJECTION, RerunScene
from msg_adapters.errors import AdapterError
from msg_adapters.output_messages.clouds import read_uncertainty_cloud

DEPTH = 10
ERROR_KEY = "reprojection error [px]"
"""Key of the reprojection error in ~/certificate."""


class PersonTopics:
    """Subscribes to the outputs of one person and logs them. A message that cannot be shown raises AdapterError."""

    def __init__(
        self,
        node: Node,
        scene: RerunScene,
        topic_of: Callable[[str], str],
        person: str,
        show: Callable[[Callable[[Any], None]], Callable[[Any], None]],
        is_of_camera: Callable[[str], bool],
    ) -> None:
        """topic_of: the name of an output topic. person: the id, empty if one person is followed.

        show: wraps a function that logs a stamped message; sets the time and reports errors. is_of_camera: whether a
        frame is that of the image. In another one, a fixed frame, the joints cannot be projected.
        """
        self._node, self._scene, self._is_of_camera = node, scene, is_of_camera
        self._place = f"/{person}" if person else ""
        self._skeleton: Skeleton | None = None
        self.lens: Lens | None = None
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        types = {topic.name: message_class(topic.message_type) for topic in topics.PERSON_OUTPUTS}
        self._subscriptions = [
            node.create_subscription(types[name], topic_of(topics.of_person(name, person)), callback, qos)
            for name, callback, qos in (
                (topics.ROBOT_DESCRIPTION, show(self._on_description), latched),
                (topics.JOINTS, show(self._on_joints), sensor_data(DEPTH)),
                (topics.JOINT_UNCERTAINTY, show(self._on_uncertainty), sensor_data(DEPTH)),
                (topics.CERTIFICATE, show(self._on_certificate), sensor_data(DEPTH)),
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
        if self._is_of_camera(message.header.frame_id) and self.lens is not None:
            self._scene.add_outline(self._place, skeleton, self.lens.distort(project(joints)))
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
            self._node.destroy_subscription(subscription)
        self.clear()


def _height(skeleton: Skeleton) -> float:
    """Return the person's height, m, by the joints of head and ankles at rest; 1.75 for a skeleton without them."""
    names, heights = skeleton.joint_names, skeleton.rest_positions[:, 1]
    if not {"head", "left_ankle"} <= set(names):
        return 1.75
    rise = heights[names.index("head")] - heights[names.index("left_ankle")]
    return float(rise / (STANDING_HEIGHT["head"] - STANDING_HEIGHT["left_ankle"]))
