"""TF of a robot's head with a camera, for rclpy's and rosbags' message objects alike."""

import numpy as np
from scipy.spatial.transform import Rotation

from msg_adapters.output_messages.builders import set_header

OPTICAL = Rotation.from_matrix([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])
"""From the optical frame (x right, y down, z forward) to the camera's body frame (x forward, y left, z up)."""


def rpy(roll, pitch, yaw=0.0):
    """The rotation of a URDF's rpy, rad: fixed axes x, y, z."""
    return Rotation.from_euler("xyz", [roll, pitch, yaw])


def tf_message(backend, stamp_ns, *links):
    """A TFMessage of links (parent, child, scipy Rotation), with a translation (3,) m as fourth entry or none."""
    message, transforms = backend.make("tf2_msgs/msg/TFMessage"), []
    for parent, child, rotation, *place in links:
        transform = backend.make("geometry_msgs/msg/TransformStamped")
        set_header(transform.header, stamp_ns, parent)
        transform.child_frame_id = child
        turn = transform.transform.rotation
        turn.x, turn.y, turn.z, turn.w = rotation.as_quat().tolist()
        shift = transform.transform.translation
        shift.x, shift.y, shift.z = np.asarray(place[0] if place else np.zeros(3), dtype=float).tolist()
        transforms.append(transform)
    message.transforms = transforms
    return message
