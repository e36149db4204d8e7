"""The messages of a tracker about one person, for tests of the node `imitate`. Needs the extra robot and rclpy."""

from dataclasses import replace

import numpy as np

from lassokin_ros import joints
from lassokin_ros.robot.check import people
from lassokin_ros.robot.person import ANKLES
from msg_adapters.backends import RclpyBackend
from msg_adapters.output_messages.clouds import JointsReport, SkeletonCloudBuilder
from msg_adapters.output_messages.people import CLOUD_TYPE, PersonReport, people_builder

PEOPLE = people()
DOWN, BENT = PEOPLE["arms down"], PEOPLE["elbows bent"]
PERSON = PersonReport("p1", True, 0.9, np.ones(3), np.array([0, 0, 0, 1.0]), np.zeros(3), np.eye(6), np.ones((1, 3)))


class PersonMessages:
    def __init__(self):
        self._cloud = SkeletonCloudBuilder(RclpyBackend(), 24)
        self._report = people_builder(RclpyBackend(), CLOUD_TYPE)

    def of(self, stamp_ns, view, person=PERSON):
        """Return the messages of ~/people and ~/skeleton of a view, 3 m in front of a camera."""
        still, ones, turns = np.zeros(24, dtype=bool), np.ones(24), np.tile([0, 0, 0, 1.0], (24, 1))
        still[ANKLES] = view.contacts
        places, doubt = view.places + (0.0, 0.0, 3.0), np.tile(np.eye(3), (24, 1, 1))
        flags = view.usable, still, still
        figures = JointsReport(1, places, np.zeros((24, 3)), doubt, *flags, ones, ones, turns, view.up)
        people_message = self._report.fill(stamp_ns, "camera", [person])
        return people_message, self._cloud.fill(stamp_ns, "camera", figures)


def without_shoulder(view):
    usable = view.usable.copy()
    usable[joints.LEFT_SHOULDER] = False
    return replace(view, usable=usable)
