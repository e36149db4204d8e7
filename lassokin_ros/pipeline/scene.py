"""What the newest messages tell of the scene: who is present, how old they are, whether somebody is not tracked.

It changes with time even if no message arrives. Times are ns of the clock of arrivals, stamps ns.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence

import numpy as np

from lassokin_ros.pipeline.camera.placement import Placement
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.inputs import Inputs
from lassokin_ros.pipeline.people.image_tracks import SAME_BODY
from lassokin_ros.pipeline.people.matching import distances
from lassokin_ros.pipeline.people.out_of_view import Absent
from lassokin_ros.pipeline.people.roster import Presence, Roster
from lassokin_ros.pipeline.seen import Image


class Scene:
    """The newest images of the cameras, or with a topic per body of the bodies.

    Attributes
    ----------
    latest: stamp and arrival of the last message that was not refused as a whole; None before the first.
    image: its stamp and frame_id.
    refused: the sources whose last message was refused as a whole, see `Image.source`.
    detector_connected: False if nobody publishes keypoints of a camera. Set by the node; a recording has no such
        knowledge.
    """

    def __init__(self, roster: Roster, inputs: Inputs, placement: Placement) -> None:
        self._roster, self._inputs, self._placement = roster, inputs, placement
        self._sources: Collection[str] = list(inputs.streams)
        self.refused: set[str] = set()
        self.detector_connected = True
        self.reset()

    def reset(self) -> None:
        """Forget the images, and who has left the view."""
        self.latest: tuple[int, int] | None = None
        self.image: tuple[int, str] | None = None
        self._used_ns: dict[str, int] = {}  # arrival of the last message that was used, by source
        self._untracked: dict[str, tuple[int, int]] = {}  # stamp of the last image, and number of people who are in it
        # and were not tracked, by source
        self._shown_ns: dict[str, int] = {}  # arrival of the last message that shows somebody, tracked or not
        self._roster.out_of_view.reset()

    def keep(self, bodies: Collection[str]) -> None:
        """Forget the bodies that are not in the detector's list."""
        self._sources = bodies
        self.refused &= set(bodies)
        for known in self._used_ns, self._untracked, self._shown_ns:
            for gone in known.keys() - set(bodies):
                del known[gone]  # type: ignore[attr-defined]
        self._roster.out_of_view.keep(bodies)

    def set_clock_back(self, step_ns: int) -> None:
        """See `Session.set_clock_back`."""
        if self.latest is not None:
            self.latest = self.latest[0], self.latest[1] - step_ns
        self._shown_ns = {name: at_ns - step_ns for name, at_ns in self._shown_ns.items()}
        self._used_ns = {name: at_ns - step_ns for name, at_ns in self._used_ns.items()}

    def refuse(self, sources: Iterable[str]) -> None:
        """Note that the last message of sources was refused as a whole."""
        self.refused |= set(sources)

    def use(
        self, images: Sequence[Image], placed: Sequence[Image], arrival_ns: int, frames: Sequence[FrameResult]
    ) -> None:
        """Note how many people in the images of an instant were not tracked, and if they show somebody.

        placed: the images that were used, with the poses of their cameras. It is not known who is in the others.
        frames: their results.
        """
        self.refused -= {image.source for image in images}
        self._used_ns |= {image.source: arrival_ns for image in placed}
        self._untracked |= {image.source: (image.stamp_ns, image.shown) for image in images}
        for image in placed:
            self._untracked[image.source] = image.stamp_ns, self._untracked_in(image)
        self._shown_ns |= {image.source: arrival_ns for image in images if image.shown}
        if self._placement.places is not None:
            jump, forget_after = self._placement.jumps.newest, self._roster.config.forget_after
            self._roster.out_of_view.update(frames, placed, forget_after, jump)

    def _untracked_in(self, image: Image) -> int:
        """Return the number of people who are in an image and not tracked.

        A detection where a tracked person is expected is that person: a duplicate, one with few keypoints, or one of an
        image that came late.
        """
        stamp_ns, name, bodies = image.stamp_ns, image.camera.name, [person.body for person in self._roster.people]
        matched = sum(body.seen_by.get(name) == stamp_ns for body in bodies)
        if image.shown <= matched:  # the usual case
            return 0
        there = [body for body in bodies if body.unseen_s(stamp_ns) <= self.lost_after]
        expected = [body.predicted_landmarks(stamp_ns, image.camera) for body in there]
        if known := [points for points in expected if points is not None]:
            apart = distances(np.stack(known), image.people, self._roster.tracker.config.min_confidence, fewest=1)
            near = apart.min(axis=0, initial=np.inf) <= SAME_BODY
            matched = max(matched, int(np.count_nonzero(near)))
        return max(image.shown - matched, 0)

    def arrive(self, stamp_ns: int, arrival_ns: int, frame_id: str, tracked: bool, late_ns: int) -> tuple[int, str]:
        """Note the time of an instant. Return stamp and frame_id of the newest one.

        tracked: whether somebody was. late_ns: an instant that is older by less says nothing of now; others with
        somebody do, because a stamp that was ahead is left behind.
        """
        older_ns = 0 if self.latest is None else self.latest[0] - stamp_ns
        if older_ns <= 0 or (older_ns >= late_ns and tracked):
            self.latest, self.image = (stamp_ns, arrival_ns), (stamp_ns, frame_id)
        assert self.image is not None
        return self.image

    @property
    def lost_after(self) -> float:
        """Time without a result after which a person is reported as lost, s."""
        return min(self._roster.config.stale_after, self._roster.tracker.config.lost_after)

    def age_s(self, now_ns: int) -> float | None:
        """s since the newest usable message; None before the first. 0 if it came before a simulated clock."""
        if self.latest is None:
            return None
        return (now_ns - self.latest[1]) * 1e-9 if self.latest[1] else 0.0

    def presence_at(self, now_ns: int) -> Presence:
        """Return the presence at a time up to which no message has arrived. The state does not change.

        Only the stamp of the next message can remove people, because a paused recording looks like a silent detector.
        """
        if self.latest is None or self.latest[1] == 0:  # none yet, or it came before a simulated clock
            return Presence(self._roster.status, self._roster.ids)
        return self._roster.presence_at(self._stamp_at(now_ns), self._roster.config.stale_after)

    def known_empty(self, now_ns: int) -> bool:
        """Return True if it is known that nobody is in view who is not tracked.

        It is known from usable messages of all cameras in the last `stale_after`, if none of them shows somebody, be it
        a person who was tracked, or one who is too near; and not from keypoints that could not be used, such as those
        of a frozen detector. With `silent_when_empty` it is known from silence, too, while all detectors are connected.
        Nobody must have left the view, see `absent_at`. If a person is locked, nobody else counts. With a topic per
        body each body of the detector's list needs such keypoints.
        """
        config, places = self._roster.config, self._placement.places
        if not self._inputs.has_camera or self._roster.locked is not None:
            return False
        if config.topic_per_body and not self.detector_connected:
            return False
        stamp_ns = self.image_at(now_ns)[0]
        if config.silent_when_empty and self.detector_connected and places is not None:
            self._roster.out_of_view.look(places.others((), stamp_ns), stamp_ns, config.forget_after)
        stale_ns = config.stale_after * 1e9
        shown = any(now_ns - at_ns <= stale_ns for at_ns in self._shown_ns.values())
        if self.absent_at(stamp_ns) or self.refused or shown:
            return False
        if config.silent_when_empty:
            return self.detector_connected
        arrivals = self._used_ns.values()
        fresh = all(at_ns == 0 or now_ns - at_ns <= stale_ns for at_ns in arrivals)
        return fresh and len(arrivals) == len(self._sources)

    def absent_at(self, stamp_ns: int) -> list[Absent]:
        """Return who was tracked, and may be where no camera has looked since; nobody if it is unknown where they look.

        stamp_ns: ns.
        """
        return self._roster.out_of_view.at(stamp_ns, self._roster.config.nobody_after)

    def untracked_at(self, stamp_ns: int) -> int:
        """Return the number of people who are in the newest images and are not tracked, at a stamp in ns.

        Of several cameras, it is that of the camera with most of them. It is at least 1 while one of them is silent,
        or its messages cannot be used, because somebody may be before it. With a topic per body it is the number of
        bodies of the detector's list that were never tracked.
        """
        config = self._roster.config
        if config.topic_per_body:
            return self._roster.untracked_of_list
        longest_ns = max(config.forget_after, self.lost_after) * 1e9
        fresh_ns = stamp_ns - config.stale_after * 1e9
        counts = [count for seen_ns, count in self._untracked.values() if abs(stamp_ns - seen_ns) <= longest_ns]
        if config.several_cameras and not config.silent_when_empty:
            seeing = sum(seen_ns >= fresh_ns for seen_ns, _ in self._untracked.values())
            counts.append(int(seeing < len(self._sources)))
        return max(counts, default=0)

    def image_at(self, now_ns: int) -> tuple[int, str]:
        """Return stamp (ns) and frame_id for an output at a time, if no message arrives.

        The stamp advances with the clock, and keeps the delay of the last message.
        """
        if self.latest is None or self.image is None:
            return now_ns, self._placement.frame_id(self._inputs.view)
        return self._stamp_at(now_ns), self.image[1]

    def _stamp_at(self, now_ns: int) -> int:
        """The stamp of an image that arrived now with the delay of the last message.

        Without an arrival time, as before a simulated clock starts, it is the last stamp.
        """
        assert self.latest is not None
        stamp_ns, arrival_ns = self.latest
        return stamp_ns + (max(now_ns - arrival_ns, 0) if arrival_ns else 0)
