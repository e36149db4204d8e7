"""The inputs of a session: the cameras, and the messages and images that wait for what belongs to them.

A depth image is large, and often arrives a few milliseconds after the small keypoint message of its time. A robot's
localisation publishes its pose some time after the image. A message then waits, for each at most for a given time;
after that the depth image of the period before is used (`DepthImages`), or the motion is continued (`Transforms`). If
most of them are later than that, messages no longer wait for them.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from lassokin_ros.pipeline.camera.camera_selection import Camera, View
from lassokin_ros.pipeline.camera_images import CameraImages
from lassokin_ros.pipeline.image_sets import ImageSets
from lassokin_ros.pipeline.seen import Image
from lassokin_ros.pipeline.settings import NodeSettings
from msg_adapters.keypoints import stamp_of

TF_POLL_S = 0.005
"""s between two looks whether TF has come that keypoints wait for."""
MOST_FAILED_WAITS = 10
"""Value of a counter at which messages do not wait, and its maximum. It rises by 1 for a message for which something
did not come in time, and falls by 1, down to 0, for one for which it did."""


@dataclass
class Wait:
    """One thing that messages wait for.

    may_come: of a frame_id and a stamp (ns, None without one), whether it may still come. longest_s: s. last_ns: of the
    clock of arrivals, when the last one came; None if that says nothing. silent_s: s without one, after which nobody
    waits. polled_s: s between two looks, if nothing tells that it has come; 0 if something does. gives_up: whether
    messages no longer wait if it mostly comes later; a part of the wait is of use otherwise.
    """

    may_come: Callable[[str, int | None], bool]
    longest_s: float
    last_ns: Callable[[], int] | None = None
    silent_s: float = 0.5
    polled_s: float = 0.0
    gives_up: bool = True
    failed: int = 0

    def holds(self, frame_id: str, stamp_ns: int | None, waited_s: float, now_ns: int) -> bool:
        """Return True if a message waits for it."""
        if not self.may_come(frame_id, stamp_ns):
            self.failed = max(self.failed - 1, 0)
            return False
        silent = self.last_ns is not None and now_ns - self.last_ns() > 1e9 * self.silent_s
        if (self.gives_up and self.failed >= MOST_FAILED_WAITS) or silent:
            return False
        if waited_s < self.longest_s:
            return True
        self.failed += 1
        return False


class Waiting:
    """The messages of one camera that wait, in the order of their arrival. Times are ns of the clock of arrivals."""

    def __init__(self, waits: list[Wait]) -> None:
        self._waits = waits
        self._messages: deque[tuple[Any, int]] = deque()  # with the arrival
        self._held_by: Wait | None = None  # what the first message waits for
        self._looked_ns = 0

    def add(self, message: Any, arrival_ns: int) -> None:
        """Add a message, None for one that could not be read."""
        self._messages.append((message, arrival_ns))

    def ready(self, now_ns: int | None, camera: Camera | None = None) -> list[tuple[Any, int]]:
        """Take the messages that wait no longer, with their arrivals.

        now_ns: None if nothing follows. camera: gives the frame_id of messages without one.
        """
        taken = []
        self._held_by = None
        while self._messages:
            message, arrival_ns = self._messages[0]
            if now_ns is not None and self._waits:
                header, waited_s = getattr(message, "header", message), 1e-9 * (now_ns - arrival_ns)
                frame = str(getattr(header, "frame_id", "")).lstrip("/")
                if not frame and camera is not None and camera.view is not None:
                    frame = camera.view.intrinsics.frame_id
                stamp_ns = stamp_of(message)
                holding = (wait for wait in self._waits if wait.holds(frame, stamp_ns, waited_s, now_ns))
                self._held_by, self._looked_ns = next(holding, None), now_ns
                if self._held_by is not None:
                    break
            self._messages.popleft()
            taken.append((message, arrival_ns))
        return taken

    @property
    def due_at_ns(self) -> int | None:
        """The time at which `ready` must be called; None if no message waits."""
        wait = self._held_by
        if wait is None:
            return None
        end_ns = self._messages[0][1] + round(1e9 * wait.longest_s)
        return min(end_ns, self._looked_ns + round(1e9 * wait.polled_s)) if wait.polled_s else end_ns

    def set_clock_back(self, step_ns: int) -> None:
        """See `Session.set_clock_back`."""
        self._messages = deque((message, arrival_ns - step_ns) for message, arrival_ns in self._messages)
        self._looked_ns -= step_ns

    def reset(self) -> None:
        """Drop the messages."""
        self._messages.clear()
        self._held_by = None


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
        sending = [one for one in self._cameras.values() if one.arrival_ns or one.counts[one.key("received")]]
        since_ns = max((one.arrival_ns for one in sending), default=0) - 1e9 * self._config.stale_after
        return bool(sending) and all(one.unused_confidence is not None for one in sending if one.arrival_ns >= since_ns)

    @property
    def unused_confidence(self) -> float:
        """Largest confidence in the last messages without a confident keypoint; 0 if they had no keypoint."""
        return max(camera.unused_confidence or 0.0 for camera in self._cameras.values())

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

    def reset_sets(self) -> None:
        """Forget the images that wait for those of other cameras."""
        if self._sets is not None:
            self._sets.reset()

    def receive(self, stream: str, message: Any, arrival_ns: int, now_ns: int | None) -> list[tuple[Any, int]]:
        """Add a keypoint message of a stream, None for one that could not be deserialised; return as `ready`."""
        self._waiting[stream].add(message, arrival_ns)
        return self.ready(stream, now_ns)

    def ready(self, stream: str, now_ns: int | None) -> list[tuple[Any, int]]:
        """Take the messages of a stream that wait no longer, with their arrivals. now_ns: None if nothing follows."""
        return self._waiting[stream].ready(now_ns, self.streams[stream].camera)

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
