"""Evidence of a user: a floor, and one that fails."""

import numpy as np

from lassokin_ros import Evidence


class Floor(Evidence):
    """The joints are `height` m below the camera's axis, with a standard deviation of 20 mm."""

    name, count = "floor", 2

    def __init__(self, joints, height):
        self.joints, self.height = np.array(joints), height

    def linearise(self, about, columns, z):
        down = np.broadcast_to([[0.0, 1.0, 0.0]], (*z.shape, 1, 3)) / 0.02
        about.joint_columns(self.joints, down, columns)
        z[...] = self._residual(about.states)

    def cost(self, states, frame):
        return 0.5 * (self._residual(states) ** 2).sum(-1)

    def _residual(self, states):
        return (self.height - states.pose.positions[..., self.joints, 1]) / 0.02


class Faulty(Evidence):
    """Raises from its n-th linearisation on."""

    name, count = "faulty", 1

    def __init__(self, good=30):
        self.good = good

    def linearise(self, about, columns, z):
        self.good -= 1
        if self.good < 0:
            raise ZeroDivisionError("no floor here")
        columns[...], z[...] = 0.0, 0.0

    def cost(self, states, frame):
        return np.zeros(states.state.translation.shape[:-1])
