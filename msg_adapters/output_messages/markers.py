"""A skeleton as visualization_msgs/MarkerArray: bones as lines, joints as spheres."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

import numpy as np

from msg_adapters.backends import Backend
from msg_adapters.output_messages.builders import StampedBuilder

SPHERE, LINE_LIST, SPHERE_LIST, TEXT = 2, 5, 7, 9  # visualization_msgs/Marker
JOINT_SIZE, BONE_SIZE, FINGER_SIZE = 0.05, 0.025, 0.012  # m
JOINT_COLOUR, BONE_COLOUR, TEXT_COLOUR = (0.10, 0.45, 0.85, 1.0), (0.95, 0.60, 0.10, 1.0), (1.0, 1.0, 1.0, 1.0)
LIFETIME_NS = 1_000_000_000
"""Lifetime of a marker. The markers of a lost person disappear, and those of a person who is tracked twice per second
do not flicker."""


class SkeletonMarkersBuilder(StampedBuilder):
    """The message object is reused; each frame changes its points."""

    def __init__(
        self, backend: Backend, parents: Sequence[int], prefix: str = "", fingers: Collection[int] = ()
    ) -> None:
        """parents: (n,) index of each joint's parent, -1 for the root; prefix: of the markers' namespaces.

        fingers: indices of joints of fingers, whose bones are thin lines without spheres.
        """
        message = backend.make("visualization_msgs/msg/MarkerArray")
        pairs = [(int(parent), child) for child, parent in enumerate(parents) if parent >= 0]
        thick = [joint for pair in pairs if pair[1] not in fingers for joint in pair]
        thin = [joint for pair in pairs if pair[1] in fingers for joint in pair]
        spheres = [joint for joint in range(len(parents)) if joint not in fingers]
        bones = marker(backend, 0, f"{prefix}bones", LINE_LIST, BONE_SIZE, BONE_COLOUR, len(thick))
        joints = marker(backend, 1, f"{prefix}joints", SPHERE_LIST, JOINT_SIZE, JOINT_COLOUR, len(spheres))
        message.markers = [bones, joints]
        if thin:
            message.markers += [marker(backend, 2, f"{prefix}fingers", LINE_LIST, FINGER_SIZE, BONE_COLOUR, len(thin))]
        self._order = np.array([*thick, *spheres, *thin])
        self._targets = [point for made in message.markers for point in made.points]
        super().__init__(message, [marker.header for marker in message.markers])

    def numbers(self, positions: np.ndarray) -> np.ndarray:
        """positions: (n, 3) m."""
        return positions.take(self._order, axis=0).reshape(-1)

    def write(self, numbers: np.ndarray) -> None:
        """See StampedBuilder.write."""
        for target, place in zip(self._targets, numbers.reshape(-1, 3).tolist()):
            target.x, target.y, target.z = place


def marker(
    backend: Backend, number: int, namespace: str, kind: int, size: float, colour: tuple[float, ...], points: int
) -> Any:
    """Return a Marker with LIFETIME_NS. size: m; colour: see `paint`; points: their number."""
    made = backend.make("visualization_msgs/msg/Marker")
    made.ns, made.id, made.type = namespace, number, kind
    made.pose.orientation.w = 1.0
    made.scale.x = made.scale.y = made.scale.z = size
    paint(made, colour)
    lifetime(made)
    made.points = [backend.make("geometry_msgs/msg/Point") for _ in range(points)]
    return made


def paint(marker: Any, colour: tuple[float, ...]) -> None:
    """Give a Marker a colour: red, green, blue, opacity, 0 to 1."""
    marker.color.r, marker.color.g, marker.color.b, marker.color.a = colour


def lifetime(marker: Any) -> None:
    """Set the lifetime of a Marker to LIFETIME_NS."""
    marker.lifetime.sec, marker.lifetime.nanosec = divmod(LIFETIME_NS, 1_000_000_000)
