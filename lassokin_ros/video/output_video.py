"""The output video: the image of each camera with its keypoints and the reprojected skeleton, beside the body in 3D."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from lassokin_ros.common.atomic_files import AtomicFiles
from lassokin_ros.core.errors import LassokinError
from lassokin_ros.doubt.doubt import Doubt
from lassokin_ros.doubt.monitor import AROUND_S
from lassokin_ros.pipeline.frame_result import FrameResult, ImageOfPerson
from lassokin_ros.pipeline.image_sets import SAME_INSTANT_NS
from lassokin_ros.replay.body import side_of
from lassokin_ros.video.body_view import BACKGROUND, COLOURS, NAME, BodyView
from lassokin_ros.video.sources import Image, is_utf8, stamp_of

HEIGHT, HEIGHT_OF_SEVERAL = 720, 480
"""px, at most: height of one camera's image, and of the images of several."""
KEYPOINT, TEXT, WRONG = (60, 220, 60), (235, 235, 235), (0, 159, 230)
"""Colours, BGR."""
NOBODY = "nobody tracked"
BAR = 0.05
"""Height of the line of text, as a share of the image's height."""
QUALITY, PRESET = 21, "veryfast"
"""Constant rate factor of libx264 (smaller is better), and its trade-off of time and size."""
LARGEST_DENOMINATOR = 1001
"""Frame rates are fractions such as 30000 / 1001."""


class VideoError(LassokinError):
    """The output video cannot be written."""


@dataclass
class _Waiting:
    """A picture that waits for the doubts of later frames. target: number of images after it. state: its text."""

    seconds: float
    target: int
    picture: np.ndarray
    state: str
    doubt: Doubt | None


class OutputVideo:
    """Writes one video."""

    def __init__(
        self, path: Path, sizes: Mapping[str, tuple[int, int]], fps: float, files: AtomicFiles, level: np.ndarray
    ) -> None:
        """sizes: (width, height) px of each camera's images, by name. files: takes the file. level: see `BodyView`.

        Raises VideoError.
        """
        import cv2

        self._part = files.part(path)
        if path.suffix.lower() not in (".mp4", ".avi"):
            raise VideoError(f"--video '{path}'; expected a name that ends in .mp4 or .avi")
        if not is_utf8(path):  # OpenCV and FFmpeg crash
            name = str(path).encode(errors="backslashreplace").decode()
            raise VideoError(f"--video '{name}' is not UTF-8; choose another name")
        self._cv2, self._path, self._fps = cv2, path, fps
        most = min(HEIGHT if len(sizes) == 1 else HEIGHT_OF_SEVERAL, next(iter(sizes.values()))[1])
        height = max(round(most), 2)
        self._sizes = {name: (max(round(size[0] * most / size[1]), 2), height) for name, size in sizes.items()}
        self._size = sum(width for width, _ in self._sizes.values()), height
        self._bar = max(round(BAR * self._size[1]), 12)
        even = (self._size[0] + self._size[1]) // 2 * 2, (self._size[1] + self._bar) // 2 * 2
        self._view = BodyView(cv2, self._size[1], level)
        self._images: deque[Mapping[str, Image]] = deque()  # of the instants whose results are not known yet
        self._apart_ns = 0 if "" in sizes else SAME_INSTANT_NS
        self._waiting: deque[_Waiting] = deque()
        self._wrong_until = -np.inf
        self._held: np.ndarray | None = None
        """The picture that is repeated until the time of the next one."""
        self._person = ""
        """The person in the view of the body."""
        self._encoder = open_encoder(self._part, even, fps)
        self._written = 0

    @property
    def browsers_play(self) -> bool:
        """Whether browsers play the file."""
        return self._encoder.browsers_play

    def add_images(self, images: Mapping[str, Image]) -> None:
        """Add the images of one instant, by camera. They wait for their results."""
        self._images.append(images)

    def add(self, stamp_ns: int, frames: Sequence[FrameResult]) -> None:
        """Show the results of an instant, and none in the images before it. Raises VideoError."""
        while self._images and (own_ns := stamp_of(_seconds(self._images[0]))) <= stamp_ns:
            self._draw(self._images.popleft(), list(frames) if stamp_ns - own_ns <= self._apart_ns else [])

    def _draw(self, images: Mapping[str, Image], frames: list[FrameResult]) -> None:
        """Draw one instant. Pictures are repeated or left out to keep the frame rate constant."""
        seconds = _seconds(images)
        accepted = [frame for frame in frames if frame.accepted]
        shown = next((frame for frame in accepted if frame.person == self._person), next(iter(accepted), None))
        self._person = self._person if shown is None else shown.person
        doubts = [frame.doubt for frame in accepted]
        doubt = next((doubt for doubt in doubts if doubt.likely_wrong), None)
        state = NOBODY if shown is None else "tracked" if len(doubts) == 1 else f"{len(doubts)} people tracked"
        target = round(seconds * self._fps) + 1
        picture = self._picture(seconds, images, frames, shown)
        self._waiting.append(_Waiting(seconds, target, picture, state, doubt))
        self._write_until(seconds - AROUND_S)

    def _write_until(self, seconds: float) -> None:
        """Write the pictures up to a time; those that follow show what is likely wrong."""
        while self._waiting and self._waiting[0].seconds <= seconds:
            waiting = self._waiting.popleft()
            near = [waiting, *(later for later in self._waiting if later.seconds <= waiting.seconds + AROUND_S)]
            if waiting.doubt is not None and waiting.doubt.has_sign:
                self._wrong_until = waiting.seconds + AROUND_S
            wrong = waiting.doubt is not None or waiting.seconds <= self._wrong_until
            wrong = wrong or any(one.doubt is not None and one.doubt.has_sign for one in near)
            self._label(waiting, wrong and waiting.state != NOBODY)
            held = waiting.picture if self._held is None else self._held
            while self._written < waiting.target:
                self._write(waiting.picture if self._written == waiting.target - 1 else held)
            self._held = waiting.picture

    def _write(self, picture: np.ndarray) -> None:
        try:
            self._encoder.write(picture)
        except OSError as error:
            raise VideoError(f"'{self._path}' cannot be written: {error.strerror or error}") from None
        self._written += 1

    def _picture(
        self, seconds: float, images: Mapping[str, Image], frames: list[FrameResult], shown: FrameResult | None
    ) -> np.ndarray:
        """Return the images and the view of the body above an empty line for the text."""
        left = [self._image(name, images[name].rgb, frames) for name in self._sizes]
        halves = np.hstack([*left, self._view.draw(seconds, shown)])
        bar = np.full((self._bar + 1, halves.shape[1], 3), BACKGROUND, np.uint8)
        height, width = (self._size[1] + self._bar) // 2 * 2, halves.shape[1] // 2 * 2
        return np.ascontiguousarray(np.vstack([halves, bar])[:height, :width])

    def _image(self, name: str, rgb: np.ndarray, frames: list[FrameResult]) -> np.ndarray:
        """Return the image of a camera with skeletons and keypoints."""
        cv2, scale = self._cv2, self._sizes[name][1] / rgb.shape[0]
        image: np.ndarray = cv2.cvtColor(cv2.resize(rgb, self._sizes[name]), cv2.COLOR_RGB2BGR)
        for frame in frames:
            own = next((one for one in frame.images if one.camera.name == name), None)
            if own is None:
                continue
            if frame.accepted:
                self._skeleton(image, frame, own, scale)
            if own.detected is not None:
                for x, y in own.detected[np.isfinite(own.detected).all(axis=1)] * scale:
                    cv2.circle(image, (round(x), round(y)), 3, KEYPOINT, -1, cv2.LINE_AA)
        return image

    def _skeleton(self, image: np.ndarray, frame: FrameResult, own: ImageOfPerson, scale: float) -> None:
        """Draw the projected bones; those that no keypoint shows are thin."""
        assert frame.estimate is not None and frame.estimate.pose is not None and frame.skeleton is not None
        points = own.project(frame.estimate.pose.positions) * scale
        limit, names, observed = 4 * max(image.shape), frame.skeleton.joint_names, frame.observed
        for joint, parent in enumerate(frame.skeleton.parents):
            ends = points[[parent, joint]]
            if parent >= 0 and (np.abs(ends) < limit).all():  # False for NaN
                first, second = ends.astype(int).tolist()
                colour, seen = COLOURS[side_of(names[parent], names[joint])], observed[[parent, joint]].any()
                self._cv2.line(image, first, second, colour, 2 if seen else 1, self._cv2.LINE_AA)

    def _label(self, waiting: _Waiting, wrong: bool) -> None:
        """Write time and state below the picture, and the side of the view; mark a picture that is likely wrong."""
        picture, (width, height) = waiting.picture, self._size
        if wrong:
            self._cv2.rectangle(picture, (0, height), (picture.shape[1], picture.shape[0]), WRONG, -1)
            self._cv2.rectangle(picture, (1, 1), (width - 2, height - 2), WRONG, 3)
        state = f"{waiting.state}; likely wrong" if wrong else waiting.state
        colour = (0, 0, 0) if wrong else TEXT
        self._text(picture, f"{waiting.seconds:.2f} s   {state}", (8, height), colour)
        self._text(picture, NAME, (width + 8, 0), TEXT)

    def _text(self, picture: np.ndarray, text: str, at: tuple[int, int], colour: tuple[int, int, int]) -> None:
        """Write a text in the line at the bottom. at: px of the line's upper left corner."""
        size = self._bar / 36
        baseline = at[0], at[1] + round(0.7 * self._bar)
        self._cv2.putText(picture, text, baseline, self._cv2.FONT_HERSHEY_SIMPLEX, size, colour, 1, self._cv2.LINE_AA)

    def finish(self) -> None:
        """Close the file. Raises VideoError."""
        while self._images:  # after the last result
            self._draw(self._images.popleft(), [])
        self._write_until(np.inf)
        try:
            self._encoder.close()
        except OSError as error:
            raise VideoError(f"'{self._path}' cannot be written: {error.strerror or error}") from None
        if not self._is_complete():
            raise VideoError(f"'{self._path}' cannot be written completely; is there room for it on the disk?")

    def _is_complete(self) -> bool:
        """Return whether the file has all images. OpenCV reports no error when it writes them."""
        video = self._cv2.VideoCapture(str(self._part))
        try:
            count = int(video.get(self._cv2.CAP_PROP_FRAME_COUNT)) if video.isOpened() else 0
            video.set(self._cv2.CAP_PROP_POS_FRAMES, max(count - 1, 0))
            return self._written == 0 or (count >= self._written and bool(video.grab()))
        finally:
            video.release()


def _seconds(images: Mapping[str, Image]) -> float:
    """Return the time of the images of one instant."""
    return next(iter(images.values())).seconds


def open_encoder(path: Path, size: tuple[int, int], fps: float) -> AvEncoder | OpenCvEncoder:
    """Return an encoder for a path that ends in .mp4 or .avi. size: (width, height) px, even. Raises VideoError.

    The wheels of PyAV have libx264, for H.264, which browsers play. OpenCV's wheels can encode MPEG-4 part 2, which no
    browser plays, and VP9, which takes ten times as long; OpenCV of Ubuntu has H.264.
    """
    try:
        import av
    except ImportError:
        return OpenCvEncoder(path, size, fps)
    return AvEncoder(av, path, size, fps)


class AvEncoder:
    """Writes H.264 by PyAV."""

    browsers_play = True
    """Whether browsers play the file."""

    def __init__(self, av: Any, path: Path, size: tuple[int, int], fps: float) -> None:
        """See `open_encoder`. av: the module."""
        self._av = av
        options = {"movflags": "+faststart"} if path.suffix.lower() == ".mp4" else {}
        rate = Fraction(fps).limit_denominator(LARGEST_DENOMINATOR)
        try:
            self._container: Any = av.open(str(path), "w", options=options)
            self._stream: Any = self._container.add_stream("libx264", rate=rate)
        except (OSError, ValueError) as error:
            raise VideoError(f"'{path}' cannot be written: {error}") from None
        self._stream.width, self._stream.height = size
        self._stream.pix_fmt = "yuv420p"
        self._stream.options = {"crf": str(QUALITY), "preset": PRESET}

    def write(self, bgr: np.ndarray) -> None:
        """Add an image. Raises OSError if the disk is full."""
        self._container.mux(self._stream.encode(self._av.VideoFrame.from_ndarray(bgr, format="bgr24")))

    def close(self) -> None:
        """End the file. Raises OSError if the disk is full."""
        if self._container is not None:
            container, self._container = self._container, None
            try:
                container.mux(self._stream.encode(None))
            finally:
                container.close()


class OpenCvEncoder:
    """Writes H.264 by OpenCV if its FFmpeg can encode it, else MPEG-4 part 2."""

    def __init__(self, path: Path, size: tuple[int, int], fps: float) -> None:
        """See `open_encoder`."""
        import cv2

        for codec in ("avc1", "mp4v"):
            self._writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*codec), fps, size)
            if self._writer.isOpened():
                self.browsers_play = codec == "avc1"
                return
        raise VideoError(f"'{path}' cannot be written by OpenCV")

    def write(self, bgr: np.ndarray) -> None:
        """Add an image. OpenCV reports no error."""
        self._writer.write(bgr)

    def close(self) -> None:
        """End the file."""
        self._writer.release()
