"""The cameras in /diagnostics: figures of each, and what is wrong with their images and their poses."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator

import numpy as np

from lassokin_ros.pipeline.camera_images import CameraImages
from lassokin_ros.pipeline.depth_images import MATCHED, RECEIVED, UNMATCHED
from lassokin_ros.pipeline.people.camera_agreement import LEFT_OUT
from lassokin_ros.pipeline.pipeline import Pipeline

SILENCE_S = 2.0
"""s: a longer period without keypoints of one of several cameras is a warning."""

OF_DEPTH = RECEIVED, MATCHED, UNMATCHED
"""Counts of depth images that are shown of each camera."""
APART_S = 0.06
"""s: difference of the delays of two cameras that is a warning. Prediction over it costs a quarter of the accuracy."""


class CameraStatus:
    """Collects the figures of several cameras, or of one in a fixed frame, over one period."""

    def __init__(self, pipeline: Pipeline) -> None:
        self._pipeline = pipeline
        self._received: Counter[str] = Counter()
        self._changed: dict[str, float] = {}  # s: when the number of messages was last seen to change
        self._since: float | None = None  # s: the first call
        self._sending: list[str] = []  # cameras with messages in the last period

    def update(self, now: float, period: float) -> dict[str, str]:
        """Return the figures by name. now: s, steady clock; period: s since the last call."""
        if self._pipeline.places is None:
            return {}
        figures, self._sending = {}, []
        self._since = now if self._since is None else self._since
        for name, camera in self._pipeline.cameras.items():
            recent = camera.received - self._received[name]
            self._received[name] = camera.received
            if recent:
                self._changed[name] = now
                self._sending.append(name)
            prefix = f"{name}: " if name else ""
            if name:
                figures[f"{prefix}input rate [Hz]"] = f"{recent / period:.2f}"
                age = now - self._changed[name] if name in self._changed else math.inf
                figures[f"{prefix}keypoints age [s]"] = f"{age:.1f}"
                residual = float(np.median(camera.residuals)) if camera.residuals else math.nan
                figures[f"{prefix}residual median [px]"] = f"{residual:.2f}"
            count = self._pipeline.counts[f"no transform of {name}" if name else "no transform"]
            figures[f"{prefix}no transform [messages]"] = str(count)
            if left_out := self._pipeline.counts[f"{name}: {LEFT_OUT}"]:
                figures[f"{prefix}{LEFT_OUT} [messages]"] = str(left_out)
            if name and camera.depth is not None:
                for key in OF_DEPTH:
                    figures[f"{prefix}{key} [messages]"] = str(self._pipeline.counts[camera.key(key)])
            figures |= {f"{prefix}{key}": value for key, value in self._pose_figures(name)}
        return figures

    def _pose_figures(self, name: str) -> Iterator[tuple[str, str]]:
        extrinsics = self._pipeline.extrinsics
        solution = None if extrinsics is None else extrinsics.solution(name)
        if extrinsics is not None and name in extrinsics.found:
            yield "pose", "found from the person"
        elif solution is not None:
            angle, shift = solution
            yield "pose differs from the given one [deg]", f"{math.degrees(angle):.2f}"
            yield "pose differs from the given one [m]", f"{shift:.3f}"

    def concerns(self, now: float) -> Iterator[str]:
        """Yield what is wrong, in words. now: s."""
        pipeline = self._pipeline
        if pipeline.places is None:
            return
        yield from pipeline.places.faults.values()
        if len(pipeline.cameras) == 1:
            return
        if shared := pipeline.places.shared_frame:
            yield shared
        silent = pipeline.config.silent_when_empty and pipeline.detector_connected
        for name, camera in pipeline.cameras.items():
            if camera.camera.view is None:
                yield f"no camera_info of camera '{name}'"
            elif not silent and now - self._changed.get(name, self._since or now) > SILENCE_S:
                yield f"no keypoints of camera '{name}' for more than {SILENCE_S:g} s"
        yield from self._clocks()
        yield from pipeline.agreement.left_out.values()
        wrong = list(self._wrong_poses())
        yield from wrong or pipeline.agreement.undecided()

    def _clocks(self) -> Iterator[str]:
        """Yield that the stamps of two cameras are of different clocks, or one of the detectors is slower."""
        cameras = ((name, self._pipeline.cameras[name]) for name in self._sending)
        delays = {name: camera.delay_s for name, camera in cameras if camera.delay_s is not None}
        if len(delays) < 2:
            return
        first, last = min(delays, key=delays.__getitem__), max(delays, key=delays.__getitem__)
        if (apart := delays[last] - delays[first]) > APART_S:
            yield (
                f"keypoints of '{last}' arrive {apart:.2f} s later after their stamps than those of '{first}': its "
                "clock differs, or its detector is slower; then set wait to that"
            )

    def _wrong_poses(self) -> Iterator[str]:
        if (extrinsics := self._pipeline.extrinsics) is not None:
            yield from filter(None, map(extrinsics.in_words, self._pipeline.cameras))

    @property
    def fault(self) -> str:
        """Why no camera that sends keypoints can be used, in words; empty if one can."""
        places = self._pipeline.places
        if places is None or not self._sending or any(name not in places.faults for name in self._sending):
            return ""
        return places.fault


def of_each_camera(pipeline: Pipeline, words: Callable[[CameraImages], str]) -> str:
    """Return the words about all cameras, with the name before those about one of several."""
    found = ((name, words(camera)) for name, camera in pipeline.cameras.items())
    return "; ".join(f"camera '{name}': {text}" if name else text for name, text in found if text)
