"""Which images of several cameras share one lasso: those of one instant, in the order of their stamps.

An image waits for those of other cameras only if they are due: by the last stamp and the period of a camera, its next
image is not newer. Cameras that run freely therefore cause no delay, and a camera whose images do not come in time is
not waited for.
"""

from __future__ import annotations

from dataclasses import dataclass

from lassokin_ros.pipeline.seen import Image

LATE = "late: only tracks updated"
"""Key of the count of images that came after a later one of another camera was used."""
LONGEST_LATE_NS = 1_000_000_000
"""ns: images of one of several cameras are later than those of the others by less than this; otherwise stamps have
jumped back."""
SAME_INSTANT_NS = 5_000_000
"""ns: images with stamps within this time share one lasso."""
MOST_PERIODS = 3
"""Periods without an image after which a camera is silent."""
MOST_FAILED_WAITS = 10
"""Value of a counter at which a camera is not waited for, and its maximum. It rises by 1 for an image that did not come
in time, and falls by 1, down to 0, for one that did."""
MOST_HELD = 100
"""Images that wait at most; then the oldest are processed."""


@dataclass
class _Timing:
    """Stamps of one camera: the newest one and the period, ns; failed: see MOST_FAILED_WAITS."""

    newest_ns: int
    period_ns: int | None = None
    failed: int = 0


class ImageSets:
    """Holds the images of several cameras until they can be processed."""

    def __init__(self, wait_s: float) -> None:
        """wait_s: longest time for which an image waits, s."""
        self._wait_ns = round(1e9 * wait_s)
        self.reset()

    def reset(self) -> None:
        """Forget all images and stamps."""
        self._held: list[tuple[Image, int]] = []  # with the arrival, ns
        self._timings: dict[str, _Timing] = {}
        self._released = 0, 0  # stamp and arrival of the newest image that did not wait any more, ns

    def set_clock_back(self, step_ns: int) -> None:
        """See `Session.set_clock_back`."""
        self._held = [(image, arrival_ns - step_ns) for image, arrival_ns in self._held]

    @property
    def due_at_ns(self) -> int | None:
        """Time in ns of the arrival clock at which the wait of the first image ends; None if no image waits."""
        return min(arrival for _, arrival in self._held) + self._wait_ns if self._held else None

    def add(self, name: str, image: Image, arrival_ns: int) -> list[list[Image]]:
        """Add an image of a camera; return the sets of images to process now, in the order of their stamps."""
        self._note(name, image.stamp_ns, arrival_ns)
        self._held.append((image, arrival_ns))
        self._held.sort(key=lambda entry: entry[0].stamp_ns)
        return self.due(arrival_ns)

    def due(self, now_ns: int) -> list[list[Image]]:
        """Return the sets of images to process at a time of the arrival clock, ns."""
        sets: list[list[Image]] = []
        while self._held:
            first_ns = self._held[0][0].stamp_ns
            group: dict[str, tuple[Image, int]] = {}
            for image, arrival_ns in self._held:
                if image.stamp_ns - first_ns <= SAME_INSTANT_NS and image.camera.name not in group:
                    group[image.camera.name] = image, arrival_ns
            missing = self._missing(first_ns, group)
            arrived_ns = min(arrival_ns for _, arrival_ns in group.values())
            if missing and now_ns - arrived_ns < self._wait_ns and len(self._held) < MOST_HELD:
                return sets
            for name in missing:
                timing = self._timings[name]
                timing.failed = min(timing.failed + 1, MOST_FAILED_WAITS)
            self._held = [entry for entry in self._held if entry not in group.values()]
            self._released = first_ns, arrived_ns
            sets.append([image for image, _ in group.values()])
        return sets

    def flush(self) -> list[list[Image]]:
        """Return all sets of images that wait."""
        return self.due(max((arrival for _, arrival in self._held), default=0) + self._wait_ns)

    def _note(self, name: str, stamp_ns: int, arrival_ns: int) -> None:
        timing = self._timings.get(name)
        if timing is None:
            self._timings[name] = _Timing(stamp_ns)
            return
        step = stamp_ns - timing.newest_ns
        if step > 0:
            timing.period_ns = step if timing.period_ns is None else min(step, 2 * timing.period_ns)
            timing.newest_ns = stamp_ns
        released_ns, arrived_ns = self._released
        if stamp_ns > released_ns + SAME_INSTANT_NS or arrival_ns - arrived_ns <= self._wait_ns:
            timing.failed = max(timing.failed - 1, 0)

    def _missing(self, stamp_ns: int, group: dict[str, tuple[Image, int]]) -> list[str]:
        """Return the cameras with an image that is due up to a stamp, ns, but has not arrived."""
        return [
            name
            for name, timing in self._timings.items()
            if name not in group
            and timing.period_ns is not None
            and timing.failed < MOST_FAILED_WAITS
            and timing.newest_ns < stamp_ns - SAME_INSTANT_NS
            and timing.newest_ns + timing.period_ns <= stamp_ns + SAME_INSTANT_NS
            and stamp_ns - timing.newest_ns <= MOST_PERIODS * timing.period_ns
        ]
