"""The cameras on ~/markers: where each one is in the frame of the skeleton, also while nobody is in view."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from lassokin_ros.core.body.rotations import to_quaternion
from lassokin_ros.pipeline.session import Session
from msg_adapters.backends import Backend
from msg_adapters.output_messages.markers import CameraMarkersBuilder

MARKERS_EVERY_S = 0.2
"""s between two messages; markers disappear after 1 s without one."""

UNKNOWN_HALF = 0.5
"""Tangent of half the field of view of a camera whose camera_info has no image size."""


class CameraMarkers:
    """Makes a message of all cameras whose place is known."""

    def __init__(self, backend: Backend, session: Session) -> None:
        self._session, self._builder = session, CameraMarkersBuilder(backend)
        self._last = -math.inf

    def build(self, stamp_ns: int, now: float) -> Any | None:
        """Return the message; None if no place is known, or MARKERS_EVERY_S has not passed. now: s of any clock."""
        places = self._session.placement.places
        if places is None or now - self._last < MARKERS_EVERY_S:
            return None
        extrinsics = self._session.extrinsics
        found = {}
        for name, pose in places.newest.items():
            view = self._session.cameras[name].camera.view
            if view is None or name in places.faults:
                continue
            pose = pose if extrinsics is None else extrinsics.corrected(pose)
            if not pose.known:
                continue
            half = 0.5 * np.array(view.size) / view.lens.focal
            quaternion = to_quaternion(pose.rotation.T[None])[0]
            found[name] = pose.centre, quaternion, np.where(half > 0, half, UNKNOWN_HALF)
        if not found:
            return None
        self._last = now
        return self._builder.fill(stamp_ns, places.base, found)
