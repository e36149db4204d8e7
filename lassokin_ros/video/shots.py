"""The shots of a video, and whether the camera moves in each of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from lassokin_ros.core.body.rotations import logarithm
from lassokin_ros.core.observation import CameraPose
from lassokin_ros.detector.backend import Detected
from lassokin_ros.pipeline.camera.calibration_file import Calibration
from lassokin_ros.video.background import Background, Turn, background, even_grey, followed_share, small
from lassokin_ros.video.sources import Image, stamp_of

CHANGED, UNLINKED, FEW = 0.08, 0.2, 20
"""A cut is suspected if the histogram of colours changes by more than the first, and if less than the second share of
the points of the image before is followed. With fewer points, the image before is blank, as a black one is."""
CONFIRMED_AFTER, SAME_SHOT = 3, 0.25
"""Images after a suspected cut that are compared with the image before: a flash and a black image are no cut. Share of
its points that they then show."""
LEAST_DEGREES, LEAST_POINTS, LEAST_IMAGES = 0.4, 25, 6
"""A camera moves if it turns by more than this. With fewer points or images it cannot be told."""
LEAST_LIVE_DEGREES = 0.8
"""The same for images that come one by one, of which none is left out."""
ZOOMED, DEGREES_OF_ZOOM = 0.08, 5.0
"""Range of the log zoom that is said, and degrees by which a zoom of 1 seems to turn the camera: people who move and
are not detected are in the background."""
SURE = 0.3
"""Least confidence of a keypoint that counts for a person's box."""
KEPT_BOXES = 15
"""Images for which the last boxes are used if nobody is detected."""
HUE_BINS = (8, 4, 4)


@dataclass
class Shot:
    """Images without a cut. times: s, of each image; turns: the camera at each."""

    times: list[float] = field(default_factory=list)
    turns: list[Turn] = field(default_factory=list)

    def add(self, seconds: float, turn: Turn) -> None:
        """Add an image."""
        self.times.append(seconds)
        self.turns.append(turn)

    @property
    def rotations(self) -> list[np.ndarray]:
        """(3, 3) of each image."""
        return [turn.rotation for turn in self.turns]

    @property
    def words(self) -> str:
        """When it is."""
        return f"from {self.times[0]:.1f} to {self.times[-1]:.1f} s"

    @property
    def degrees(self) -> float:
        """Range of the rotation, without the outermost images."""
        if len(self.turns) < 2:
            return 0.0
        low, high = np.percentile(logarithm(np.array(self.rotations)), [3, 97], axis=0)
        return float(np.degrees(np.linalg.norm(high - low)))

    @property
    def is_known(self) -> bool:
        """Whether enough of the background was seen."""
        return (
            len(self.times) >= LEAST_IMAGES and float(np.median([turn.points for turn in self.turns])) >= LEAST_POINTS
        )

    @property
    def moves(self) -> bool:
        """Whether the camera turns."""
        return self.is_known and self.degrees > LEAST_DEGREES + DEGREES_OF_ZOOM * self.zoom

    @property
    def zoom(self) -> float:
        """Range of the log zoom, without the outermost images."""
        return float(np.ptp(np.percentile([turn.zoom for turn in self.turns], [3, 97]))) if self.turns else 0.0


@dataclass(frozen=True, eq=False)
class _Seen:
    """A small image with its mask and histogram. seconds: s."""

    seconds: float
    grey: np.ndarray
    mask: np.ndarray
    colours: np.ndarray


class Footage:
    """Follows the background of a video, image by image."""

    def __init__(self, lens: Calibration, size: tuple[int, int], content: tuple[int, int], cuts: bool = True) -> None:
        """size: (width, height) px of the images; content: of the part between black bars. cuts: look for cuts."""
        self._lens, self._cuts, self._bars = lens, cuts, (np.array(size) - np.array(content)) / 2
        self.shots = [Shot()]
        self._before: _Seen | None = None
        self._held: list[_Seen] = []  # images after a suspected cut
        self._boxes, self._boxes_age = np.zeros((0, 2, 2)), 0
        self._background = self._new()
        self._by_stamp: dict[int, np.ndarray] = {}

    def _new(self, scale: float = 1.0) -> Background:
        return Background(scale * float(np.sqrt(self._lens.K[0, 0] * self._lens.K[1, 1])), scale * self._lens.K[:2, 2])

    def add(self, image: Image, people: Sequence[Detected]) -> None:
        """Use an image with the people in it."""
        picture = small(image.rgb)
        grey = even_grey(picture)
        scale = 1 / (image.rgb.shape[1] // grey.shape[1])
        if self._before is None:
            self._scale, self._background = scale, self._new(scale)
        mask = background(grey.shape, self._boxes_of(people) * scale, self._bars * scale)
        seen = _Seen(image.seconds, grey, mask, _colours(picture))
        if self._held:
            self._held.append(seen)
            if len(self._held) > CONFIRMED_AFTER:
                self._decide()
            return
        self._follow(seen)

    def finish(self) -> None:
        """No image follows."""
        if self._held:
            self._decide()

    def _follow(self, seen: _Seen) -> None:
        before = self._before
        if before is not None and self._cuts and self._is_suspect(before, seen):
            self._held = [seen]
            return
        self.shots[-1].add(seen.seconds, self._background.step(seen.grey, seen.mask))
        self._before = seen

    def _is_suspect(self, before: _Seen, seen: _Seen) -> bool:
        """Whether a new shot may begin with an image."""
        changed = 0.5 * float(np.abs(before.colours - seen.colours).sum())
        return changed > CHANGED and followed_share(before.grey, seen.grey, FEW) < UNLINKED

    def _decide(self) -> None:
        """Decide whether the held images begin a new shot."""
        held, self._held, before = self._held, [], self._before
        assert before is not None
        if not any(followed_share(before.grey, seen.grey, FEW) > SAME_SHOT for seen in held[1::2] or held):
            self.shots.append(Shot())
            self._background = self._new(self._scale)
            for seen in held:
                self.shots[-1].add(seen.seconds, self._background.step(seen.grey, seen.mask))
            self._before = held[-1]
            return
        last = self.shots[-1]
        for seen in held[:-1]:  # a flash: the camera is taken to stand
            last.add(seen.seconds, last.turns[-1])
        last.add(held[-1].seconds, self._background.step(held[-1].grey, held[-1].mask))
        self._before = held[-1]

    def _boxes_of(self, people: Sequence[Detected]) -> np.ndarray:
        """Return the boxes (p, 2, 2) px of the people, or the last ones for a while."""
        sure = [one.pixels[one.confidence > SURE] for one in people]
        boxes = [np.stack([points.min(axis=0), points.max(axis=0)]) for points in sure if len(points) > 3]
        if boxes:
            self._boxes, self._boxes_age = np.array(boxes), 0
        elif self._boxes_age < KEPT_BOXES:
            self._boxes_age += 1
        else:
            self._boxes = np.zeros((0, 2, 2))
        return self._boxes

    @property
    def cuts(self) -> list[float]:
        """s: the first image of each shot but the first."""
        return [shot.times[0] for shot in self.shots[1:]]

    @property
    def moves(self) -> bool:
        """Whether the camera turns in a shot."""
        return any(shot.moves for shot in self.shots)

    def pose(self, stamp_ns: int) -> CameraPose:
        """Return the camera's pose in the frame of the first image of its shot; that image's own for a still camera."""
        if len(self._by_stamp) != sum(len(shot.times) for shot in self.shots):
            self._by_stamp = {
                stamp_of(at): rotation if shot.moves else np.eye(3)
                for shot in self.shots
                for at, rotation in zip(shot.times, shot.rotations)
            }
        return CameraPose("", self._by_stamp.get(stamp_ns, np.eye(3)), np.zeros(3))

    def begins_at(self, seconds: float) -> bool:
        """Whether an image at a time, s, is the first of a shot but the first one."""
        return seconds in self.cuts

    def unknown(self) -> list[str]:
        """Return of which shots it cannot be told whether the camera moves, in a sentence."""
        shots = [shot for shot in self.shots if not shot.is_known and len(shot.times) >= LEAST_IMAGES]
        when = ", ".join(shot.words for shot in shots)
        words = f"It cannot be told whether the camera moves {when}: too little background is seen."
        return [words] if shots else []

    def remarks(self) -> list[str]:
        """Return what the background shows, in sentences."""
        found = []
        if self.cuts:
            listed = ", ".join(f"{at:.2f} s" for at in self.cuts)
            found.append(
                f"A new shot begins at {listed}. Each is tracked as a take of its own, with the lengths learned in all."
            )
        if turns := [f"by {shot.degrees:.1f} degrees {shot.words}" for shot in self.shots if shot.moves]:
            found.append(
                f"The camera turns {', '.join(turns)}. Its rotation is taken out: positions are in the frame of the "
                "first image of each shot. A camera that is moved sideways looks alike, and is not told apart."
            )
        zoomed = [shot for shot in self.shots if shot.is_known and shot.zoom > ZOOMED]
        if zooms := [f"{shot.words} by a factor of {np.exp(shot.zoom):.2f}" for shot in zoomed]:
            found.append(
                f"The camera zooms, or comes nearer, {', '.join(zooms)}. This is not taken out: the person seems to "
                "come nearer, too."
            )
        return found


def _colours(rgb: np.ndarray) -> np.ndarray:
    """Return the histogram of hue, saturation and value, with the sum 1."""
    import cv2

    hsv = cv2.cvtColor(cv2.resize(rgb, (64, 64), interpolation=cv2.INTER_AREA), cv2.COLOR_RGB2HSV)
    found = cv2.calcHist([hsv], [0, 1, 2], None, list(HUE_BINS), [0, 180, 0, 256, 0, 256])
    return np.asarray(found / found.sum())


class LiveFootage(Footage):
    """The same for images that come one by one and do not end: no cuts, and nothing of the past is kept."""

    def __init__(self, lens: Calibration, size: tuple[int, int], content: tuple[int, int]) -> None:
        """See Footage."""
        super().__init__(lens, size, content, cuts=False)
        self._low, self._high = np.full(3, np.inf), np.full(3, -np.inf)
        self._moves = False

    def add(self, image: Image, people: Sequence[Detected]) -> None:
        """Use an image with the people in it."""
        super().add(image, people)
        (shot,) = self.shots
        del shot.times[:-1], shot.turns[:-1]
        if shot.turns[-1].points >= LEAST_POINTS:
            vector = logarithm(shot.turns[-1].rotation[None])[0]
            self._low, self._high = np.minimum(self._low, vector), np.maximum(self._high, vector)
            turned = float(np.degrees(np.linalg.norm(self._high - self._low)))
            self._moves = self._moves or turned > LEAST_LIVE_DEGREES

    @property
    def moves(self) -> bool:
        """Whether the camera has turned since the beginning. Until then, it is taken to stand."""
        return self._moves

    def pose(self, stamp_ns: int) -> CameraPose:
        """Return the camera's pose at its last image, in the frame of the first one."""
        turns = self.shots[0].turns
        return CameraPose("", turns[-1].rotation if self.moves and turns else np.eye(3), np.zeros(3))
