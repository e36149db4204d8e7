"""Obstacles for a costmap: a disc around everybody, as large as the doubt. For Nav2's obstacle layer (PointCloud2).

python3 examples/costmap.py    # people_obstacles; --ros-args -p frame:=odom

Nothing comes while it is unknown where people are: set expected_update_rate, so that the robot stops then.
"""

import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2

from lassokin_ros.node.executable import run
from lassokin_ros.watch import NOBODY, PeopleWatch, cloud, covariance, position

BODY, SIGMAS, LARGEST, STEP = 0.3, 2.0, 2.0, 0.1  # m, standard deviations, m, m


def disc(person):
    """Return points (k, 3) m at half height: the body and the doubt, in a frame with z up."""
    radius = min(BODY + SIGMAS * np.sqrt(np.linalg.eigvalsh(covariance(person)[:2, :2])[-1]), LARGEST)
    across = np.arange(-radius, radius + STEP, STEP)
    grid = np.stack(np.meshgrid(across, across, [0.0]), axis=-1).reshape(-1, 3)
    return position(person) + grid[np.linalg.norm(grid, axis=1) <= radius]


class Costmap(Node):
    """Publishes 5 times per second, also people who are lost or out of view; an empty cloud if nobody is there."""

    def __init__(self):
        super().__init__("people_costmap")
        self.watch = PeopleWatch(self, frame=self.declare_parameter("frame", "odom").value)
        self.publisher = self.create_publisher(PointCloud2, "people_obstacles", 10)
        self.create_timer(0.2, self.on_timer)

    def on_timer(self):
        """Publish everybody where they are expected now, unless somebody's place is not known."""
        people = self.watch.predicted(people=self.watch.everybody())
        if (len(people) or self.watch.state == NOBODY) and np.isfinite(people["x"]).all():
            stamp, discs = self.get_clock().now().to_msg(), [disc(person) for person in people]
            self.publisher.publish(cloud(stamp, self.watch.frame_id, np.concatenate([np.empty((0, 3)), *discs])))


if __name__ == "__main__":
    run(Costmap)
