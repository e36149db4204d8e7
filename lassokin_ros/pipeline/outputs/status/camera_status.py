"""The figures of several cameras, or of one in a fixed frame."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator

import numpy as np

from lassokin_ros.pipeline.depth.depth_images import MATCHED, RECEIVED, UNMATCHED
from lassokin_ros.pipeline.people.camera_agreement import LEFT_OUT
from lassokin_ros.pipeline.session import Session

OF_DEPTH = RECEIVED, MATCHED, UNMATCHED
"""Counts of depth images that are shown of each camera."""


class CameraStatus:
    """Follows which cameras send keypoints. Times are s of a steady clock."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._received: Counter[str] = Counter()
        self._changed: dict[str, float] = {}  # when the number of messages was last seen to change
        self._since: float | None = None  # the first call
        self.sending: list[str] = []
        """Cameras with messages in the last period."""

    def silent_s(self, now: float, name: str) -> float:
        """Return s since the last message of a camera, or since the begin."""
        return now - self._changed.get(name, now if self._since is None else self._since)

    def update(self, now: float, period: float) -> dict[str, str]:
        """Return the figures by name. period: s since the last call."""
        if self._session.placement.places is None:
            return {}
        figures: dict[str, str] = {}
        self.sending = []
        self._since = now if self._since is None else self._since
        for name, camera in self._session.cameras.items():
            recent = camera.received - self._received[name]
            self._received[name] = camera.received
            if recent:
                self._changed[name] = now
                self.sending.append(name)
            prefix = f"{name}: " if name else ""
            figures |= {f"{prefix}{key}": value for key, value in self._figures(name, now, recent / period)}
        return figures

    def _figures(self, name: str, now: float, rate: float) -> Iterator[tuple[str, str]]:
        counts, camera = self._session.counts, self._session.cameras[name]
        if name:
            yield "input rate [Hz]", f"{rate:.2f}"
            yield "keypoints age [s]", f"{now - self._changed.get(name, -math.inf):.1f}"
            yield "residual median [px]", f"{np.median(camera.residuals) if camera.residuals else math.nan:.2f}"
        yield "no transform [messages]", str(counts[f"no transform of {name}" if name else "no transform"])
        if left_out := counts[f"{name}: {LEFT_OUT}"]:
            yield f"{LEFT_OUT} [messages]", str(left_out)
        if name and camera.depth is not None:
            for key in OF_DEPTH:
                yield f"{key} [messages]", str(counts[camera.key(key)])
        extrinsics = self._session.extrinsics
        solution = None if extrinsics is None else extrinsics.solution(name)
        if extrinsics is not None and name in extrinsics.found:
            yield "pose", "found from the person"
        elif solution is not None:
            angle, shift = solution
            yield "pose differs from the given one [deg]", f"{math.degrees(angle):.2f}"
            yield "pose differs from the given one [m]", f"{shift:.3f}"
