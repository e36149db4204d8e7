"""What the newest messages tell of the scene: how old they are, and whether somebody is there who is not tracked."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from lassokin_ros.pipeline.people.people_tracker import PeopleTracker
from lassokin_ros.pipeline.seen import Image
from lassokin_ros.pipeline.settings import NodeSettings


class Scene:
    """The newest images of the cameras. Stamps and arrivals are ns.

    Attributes
    ----------
    latest: stamp and arrival of the last message that was not refused as a whole; None before the first.
    image: its stamp and frame_id.
    refused: the cameras whose last message was refused as a whole.
    """

    def __init__(self, cameras: Sequence[str]) -> None:
        """cameras: their names."""
        self._cameras = cameras
        self.refused: set[str] = set()
        self.reset()

    def reset(self) -> None:
        """Forget the images."""
        self.latest: tuple[int, int] | None = None
        self.image: tuple[int, str] | None = None
        self._used_ns: dict[str, int] = {}  # arrival of the last message that was used, by camera
        self._untracked: dict[str, tuple[int, int]] = {}  # stamp of the last image, and number of people who are in it
        # and were not tracked, by camera
        self._shown_ns: int | None = None  # arrival of the last message that shows somebody, tracked or not

    def set_clock_back(self, step_ns: int) -> None:
        """See `Session.set_clock_back`."""
        if self.latest is not None:
            self.latest = self.latest[0], self.latest[1] - step_ns
        if self._shown_ns is not None:
            self._shown_ns -= step_ns
        self._used_ns = {name: at_ns - step_ns for name, at_ns in self._used_ns.items()}

    def refuse(self, cameras: Iterable[str]) -> None:
        """Note that the last message of cameras was refused as a whole."""
        self.refused |= set(cameras)

    def use(
        self,
        images: Sequence[Image],
        placed: Sequence[Image],
        arrival_ns: int,
        people: PeopleTracker,
        tracked_for: float,
    ) -> None:
        """Note how many people in the images of an instant were not tracked, and if they show somebody.

        placed: the images that were used, with the poses of their cameras. It is not known who is in the others.
        tracked_for: see `PeopleTracker.untracked`.
        """
        self.refused -= {image.camera.name for image in images}
        self._used_ns |= {image.camera.name: arrival_ns for image in placed}
        self._untracked |= {image.camera.name: (image.stamp_ns, image.shown) for image in images}
        for image in placed:
            self._untracked[image.camera.name] = image.stamp_ns, people.untracked(image, tracked_for)
        if any(image.shown for image in images):
            self._shown_ns = arrival_ns

    def known_empty(self, now_ns: int, config: NodeSettings, detector_connected: bool) -> bool:
        """See `Session.scene_known_empty`."""
        stale_ns = config.stale_after * 1e9
        if self.refused or (self._shown_ns is not None and now_ns - self._shown_ns <= stale_ns):
            return False
        if config.silent_when_empty:
            return detector_connected
        arrivals = self._used_ns.values()
        fresh = all(at_ns == 0 or now_ns - at_ns <= stale_ns for at_ns in arrivals)
        return fresh and len(arrivals) == len(self._cameras)

    def untracked_at(self, stamp_ns: int, config: NodeSettings, tracked_for: float) -> int:
        """See `Session.untracked_at`."""
        longest_ns = max(config.forget_after, tracked_for) * 1e9
        fresh_ns = stamp_ns - config.stale_after * 1e9
        counts = [count for seen_ns, count in self._untracked.values() if abs(stamp_ns - seen_ns) <= longest_ns]
        if config.several_cameras and not config.silent_when_empty:
            seeing = sum(seen_ns >= fresh_ns for seen_ns, _ in self._untracked.values())
            counts.append(int(seeing < len(self._cameras)))
        return max(counts, default=0)

    def stamp_at(self, now_ns: int) -> int | None:
        """The stamp of an image that arrived now with the delay of the last message; None without one.

        now_ns: of the clock of arrivals. Without an arrival time, as before a simulated clock starts, it is the last
        stamp.
        """
        if self.latest is None:
            return None
        stamp_ns, arrival_ns = self.latest
        return stamp_ns + (max(now_ns - arrival_ns, 0) if arrival_ns else 0)
