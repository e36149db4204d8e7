"""Publish the joints of a robot's right hand whose fingertips follow the person's, by pinocchio's kinematics.

python3 examples/retarget_hand.py HAND.urdf thumb_link 4 index_link 8    # fingertips and their points of ~/hands
"""

import sys

import numpy as np
import pinocchio as pin
from rclpy.node import Node
from sensor_msgs.msg import JointState

from lassokin_ros.node.executable import run
from lassokin_ros.watch import PeopleWatch, points, position

MODEL, TO_MANO = pin.buildModelFromUrdf(sys.argv[1]), np.array([[0, 0, -1], [-1, 0, 0], [0, 1, 0]])
FRAMES, TIPS = [MODEL.getFrameId(link) for link in sys.argv[2::2]], [int(point) for point in sys.argv[3::2]]
DATA, Q = MODEL.createData(), pin.neutral(MODEL)  # the last posture


def follow(hand):
    """Take steps of damped least squares towards the fingertips. hand: (21,) points of ~/hands."""
    for _ in range(20):
        rows = [pin.computeFrameJacobian(MODEL, DATA, Q, frame, pin.LOCAL_WORLD_ALIGNED)[:3] for frame in FRAMES]
        pin.updateFramePlacements(MODEL, DATA)
        apart = position(hand[TIPS]).T @ TO_MANO - [DATA.oMf[frame].translation for frame in FRAMES]
        J = np.concatenate(rows)
        step = J.T @ np.linalg.solve(J @ J.T + 1e-5 * np.eye(len(J)), apart.ravel())
        Q[:] = np.clip(Q + step, MODEL.lowerPositionLimit, MODEL.upperPositionLimit)


class RetargetHand(Node):
    """Holds the posture while the hand is hidden; silent while the person is in doubt, or the message 0.5 s old."""

    def __init__(self):
        super().__init__("retarget_hand")
        self.publisher = self.create_publisher(JointState, "hand_joints", 10)
        PeopleWatch(self).subscribe("hands", self.on_hands)

    def on_hands(self, message):
        """Publish the posture."""
        (hand,) = [hand for hand in points(message).reshape(-1, 21) if hand[0]["side"] == 1]
        if hand["observed"].mean() > 0.5:
            follow(hand)
        self.publisher.publish(JointState(header=message.header, name=list(MODEL.names)[1:], position=Q.tolist()))


if __name__ == "__main__":
    run(RetargetHand)
