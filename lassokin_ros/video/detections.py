"""The keypoints of a source's images: each image is detected once and its keypoints are kept."""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

from lassokin_ros.common.command_line import print_note
from lassokin_ros.common.progress import Progress
from lassokin_ros.detector.backend import Detected, Detector, DetectorError
from lassokin_ros.video import PROGRAM
from lassokin_ros.video.people import Found, Seen
from lassokin_ros.video.sources import Image, Source, SourceError
from msg_adapters.keypoints import Keypoints

FIRST_STAMP_NS = 1_000_000_000
"""ns: stamp of an image at 0 s. A stamp of zero means no stamp."""
COMPLETE = 0.9
"""Share of the announced images or of the announced duration from which a file counts as complete."""


def stamp_of(seconds: float) -> int:
    """Return the stamp of an image, ns. seconds: its time in the source."""
    return FIRST_STAMP_NS + round(seconds * 1e9)


class Detections:
    """The images of a source with their keypoints.

    found: the people in each image, if they are kept. fault: why the source ended early, in words; empty if it did not.
    detect_seconds: time of the detector for each image, s. interrupted: the images ended because of a signal.
    """

    def __init__(self, source: Source, detector: Detector, frame_id: str, keep: bool) -> None:
        """frame_id: of the keypoints. keep: whether they are kept in `found`."""
        self._source, self._detector, self._frame_id, self._keep = source, detector, frame_id, keep
        self.found: list[Found] = []
        self.people: list[Detected] = []
        """Those in the last image."""
        self._last = self._step = 0.0  # s: time of the last image, and since the one before
        self.detect_seconds: list[float] = []
        self.fault = ""
        self.interrupted = False

    def images(self, stopped: Sequence[int], progress: Progress) -> Iterator[tuple[Image, Keypoints]]:
        """Yield each image and its keypoints. stopped: not empty after a signal. Raises a LassokinError.

        An error after the first image is kept in `fault`.
        """
        if self._source.remark:
            print_note(f"{PROGRAM}: {self._source.remark}")
        try:
            for image in self._source.images:
                if stopped:
                    break
                found = self._detect(image)
                if self._detector.several:
                    yield image, self._keypoints_of_everybody(image.seconds, found)
                else:
                    yield image, self._keypoints_of_one(image.seconds, found)
        except (SourceError, DetectorError) as error:
            if not self.detect_seconds:
                raise
            self.fault = str(error)
        finally:
            progress.close()
        self.interrupted = bool(stopped)
        self._check_end()

    def of_all(self) -> Iterator[tuple[float, Keypoints]]:
        """Yield time in s and keypoints of each kept image, with the one person whom the detector finds."""
        for seconds, found in self.found:
            yield seconds, self._keypoints_of_one(seconds, found)

    def of_everybody(self) -> Iterator[tuple[float, Keypoints]]:
        """Yield time in s and keypoints of each kept image, with all people."""
        for seconds, found in self.found:
            yield seconds, self._keypoints_of_everybody(seconds, found)

    def of_people(self, people: Sequence[tuple[int, Seen]], numbered: bool) -> Iterator[tuple[float, Keypoints]]:
        """Yield time in s and keypoints of each kept image, with some people only.

        people: number and images of each person. numbered: the numbers are in the keypoints; False for one person.
        """
        shown = [(number, dict(zip(seen.seconds.tolist(), seen.detected))) for number, seen in people]
        for seconds, _ in self.found:
            present = [(number, of[seconds]) for number, of in shown if seconds in of]
            if numbered:
                yield seconds, self._keypoints(seconds, present)
            else:
                yield seconds, self._keypoints_of_one(seconds, [person for _, person in present])

    def _detect(self, image: Image) -> list[Detected]:
        began = time.monotonic()
        found = self._detector.detect(image.rgb, image.seconds)
        self.detect_seconds.append(time.monotonic() - began)
        self.people = found
        self._step, self._last = image.seconds - self._last, image.seconds
        if self._keep:
            self.found.append((image.seconds, found))
        return found

    def _keypoints_of_everybody(self, seconds: float, found: Sequence[Detected]) -> Keypoints:
        """The detector does not know who is who."""
        return self._keypoints(seconds, [(-1 - i, one) for i, one in enumerate(found)])

    def _keypoints_of_one(self, seconds: float, found: Sequence[Detected]) -> Keypoints:
        return replace(self._keypoints(seconds, [(0, person) for person in found[:1]]), persons=None)

    def _keypoints(self, seconds: float, people: Sequence[tuple[int, Detected]]) -> Keypoints:
        """Return the keypoints of several people with their numbers, below 0 if these are valid in this image only."""
        rows = [(number, person.pixels, person.confidence) for number, person in people]
        return Keypoints.of_people(stamp_of(seconds), self._frame_id, rows)

    def _check_end(self) -> None:
        """Print a note if the file ended early. The number of images may be an estimate, and so may the duration."""
        read, source = len(self.detect_seconds), self._source
        end = source.begin + self._last + self._step  # the last image is shown as long as the one before
        early = read < COMPLETE * source.count and end < COMPLETE * source.seconds
        if early and not self.fault and not self.interrupted:
            print_note(
                f"{PROGRAM}: {source.name} announces {source.count} images, {read} could be read; it may be damaged, "
                "or its images begin later than its sound"
            )


@contextmanager
def stop_flag() -> Iterator[list[int]]:
    """Yield a list that is not empty after SIGINT or SIGTERM. A second signal acts as usual."""
    received: list[int] = []

    def stop(number: int, _: object) -> None:
        received.append(number)
        for signal_number, handler in previous.items():
            signal.signal(signal_number, handler)

    previous = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield received
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
