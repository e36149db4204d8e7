"""The inputs of a session: the cameras, and the messages and images that wait for what belongs to them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

from lassokin_ros.pipeline.camera.camera_selection import View
from lassokin_ros.pipeline.camera_images import CameraImages
from lassokin_ros.pipeline.image_sets import ImageSets
from lassokin_ros.pipeline.seen import Image
from lassokin_ros.pipeline.settings import NodeSettings
from lassokin_ros.pipeline.waiting import Wait, Waiting

TF_POLL_S = 0.005
"""s between two looks whether TF has come that keypoints wait for."""


class Inputs:
    """The messages of all cameras, and the sets of images of one instant. Times are ns of the clock of arrivals."""

    def __init__(
        self,
        cameras: Mapping[str, CameraImages],
        config: NodeSettings,
        patience: float,
        may_reach: Callable[[str, int | None], bool] | None,
    ) -> None:
        """cameras: by name. With a topic per body, the messages are those of bodies, see `keep`. patience: see
        `Session`. may_reach: whether TF may still give the pose of a frame_id at a stamp, ns; None if the poses of the
        cameras are not needed.
        """
        self._cameras, self._config = cameras, config
        self.streams = {} if config.topic_per_body else dict(cameras)
        """The inputs of each topic of keypoints, by the name of the camera or the id of the body."""
        self._waits_of = partial(_waits_of, config=config, patience=patience, may_reach=may_reach)
        self._sets = ImageSets(config.camera_wait) if config.several_cameras else None
        self._waiting = {name: Waiting(self._waits_of(stream)) for name, stream in self.streams.items()}

    def keep(self, bodies: Sequence[str]) -> None:
        """Set whose topics there are, with a topic per body."""
        for gone in self.streams.keys() - set(bodies):
            del self.streams[gone], self._waiting[gone]
        first = next(iter(self._cameras.values()))
        for body in bodies:
            if body not in self.streams:
                self.streams[body] = stream = first.of_body(body)
                self._waiting[body] = Waiting(self._waits_of(stream))

    @property
    def nobody_in_view(self) -> bool:
        """True if the last message of each camera that sends messages had no confident keypoint.

        A camera sends messages if its last one is at most `stale_after` older than the newest one.
        """
        sending = [one for one in self._cameras.values() if one.received or one.nobody_in_view]
        since_ns = max((one.arrival_ns for one in sending), default=0) - 1e9 * self._config.stale_after
        return bool(sending) and all(one.nobody_in_view for one in sending if one.arrival_ns >= since_ns)

    @property
    def unused_confidence(self) -> float:
        """Largest confidence in the last messages without a confident keypoint; 0 if they had no keypoint."""
        return max(camera.unused_confidence for camera in self._cameras.values())

    @property
    def has_camera(self) -> bool:
        """True after the first usable camera_info of any camera."""
        return any(one.camera.view is not None for one in self._cameras.values())

    @property
    def view(self) -> View | None:
        """The camera of the newest camera_info of the first camera; None before it."""
        return next(iter(self._cameras.values())).camera.view

    @property
    def camera_fault(self) -> str:
        """Why the last camera_info was refused, in words; empty if it was accepted."""
        return next((one.camera.fault for one in self._cameras.values() if one.camera.fault), "")

    @property
    def due_at_ns(self) -> int | None:
        """Time at which the wait of the first message or image ends; None if none waits."""
        times = [waiting.due_at_ns for waiting in self._waiting.values()]
        times += [None if self._sets is None else self._sets.due_at_ns]
        return min((time for time in times if time is not None), default=None)

    def tune(self, config: NodeSettings) -> None:
        """Apply settings that can change while running."""
        self._config = config

    def set_clock_back(self, step_ns: int) -> None:
        """See `Session.set_clock_back`."""
        for stream in self.streams.values():
            stream.arrival_ns -= step_ns
        for waiting in self._waiting.values():
            waiting.set_clock_back(step_ns)
        if self._sets is not None:
            self._sets.set_clock_back(step_ns)

    def reset(self) -> None:
        """Forget the depth images, and the messages that wait."""
        for waiting in self._waiting.values():
            waiting.reset()
        for camera in self._cameras.values():
            if camera.depth is not None:
                camera.depth.reset()
            camera.depth_check.reset()

    def reset_sets(self) -> None:
        """Forget the images that wait for those of other cameras."""
        if self._sets is not None:
            self._sets.reset()

    def add(self, stream: str, message: Any, arrival_ns: int) -> None:
        """Add a keypoint message of a stream, None for one that could not be deserialised."""
        self._waiting[stream].add(message, arrival_ns)

    def ready(self, stream: str, now_ns: int | None) -> list[tuple[Any, int]]:
        """Take the messages of a stream that wait no longer, with their arrivals. now_ns: None if nothing follows."""
        view = self.streams[stream].camera.view
        return self._waiting[stream].ready(now_ns, "" if view is None else view.intrinsics.frame_id)

    def sets_with(self, image: Image, arrival_ns: int) -> Sequence[Sequence[Image]]:
        """Return the sets of images of one instant to track now; a camera alone does not wait. image: the newest."""
        if self._sets is None:
            return [[image]]
        camera = self._cameras[image.camera.name]
        camera.stamps.seen(image.stamp_ns, True)
        camera.stamps.follow(image.stamp_ns, arrival_ns, image.stamped)
        return self._sets.add(camera.name, image, arrival_ns)

    def due_sets(self, now_ns: int | None) -> Sequence[Sequence[Image]]:
        """Return the sets of images whose wait has ended; now_ns: None for all."""
        if self._sets is None:
            return []
        return self._sets.flush() if now_ns is None else self._sets.due(now_ns)


def _waits_of(
    camera: CameraImages, config: NodeSettings, patience: float, may_reach: Callable[[str, int | None], bool] | None
) -> list[Wait]:
    """Return what the messages of a camera wait for; see `Inputs`."""
    waits = []
    if (depth := camera.depth) is not None:
        longest_s = max(config.depth_wait, patience)
        waits.append(Wait(lambda _, stamp_ns: depth.may_receive(stamp_ns), longest_s, lambda: depth.arrival_ns))
    if may_reach is not None:
        waits.append(Wait(may_reach, max(config.tf_wait, patience), polled_s=TF_POLL_S, gives_up=False))
    return waits
