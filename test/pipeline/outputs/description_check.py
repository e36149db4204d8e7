"""Forward kinematics of a published URDF, by an independent library."""

from xml.etree import ElementTree

import numpy as np
import pytest


class DescribedBody:
    """A robot_description, read by pinocchio."""

    def __init__(self, text):
        self.pin = pytest.importorskip("pinocchio", reason="pinocchio (pip install pin) is a test-only dependency")
        self.text = text
        links = [link.get("name") for link in ElementTree.fromstring(text.encode()).iter("link")]
        self.prefix = next(name for name in links if name.endswith("root_x_link")).removesuffix("root_x_link")
        self.model = self.pin.buildModelFromXML(text)
        self.data = self.model.createData()

    def positions(self, state):
        """(n, 3) m of the links of a JointState's ball joints, in its order."""
        q = np.zeros(self.model.nq)
        for name, value in zip(state.name, state.position):
            q[self.model.joints[self.model.getJointId(name)].idx_q] = value
        self.pin.framesForwardKinematics(self.model, self.data, q)
        names = [self.prefix + name.removesuffix("_x") for name in state.name if name.endswith("_x")][1:]
        frames = [self.model.getFrameId(name, self.pin.FrameType.BODY) for name in names]
        return np.array([self.data.oMf[frame].translation for frame in frames])

    def error(self, state, joints):
        """Largest distance of a joint from its position in the PoseArray, m."""
        places = np.array([[p.position.x, p.position.y, p.position.z] for p in joints.poses])
        return float(np.linalg.norm(self.positions(state) - places, axis=1).max())
