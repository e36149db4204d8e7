"""Sources of images: a video file, a webcam, a network stream, or a folder of images."""

from __future__ import annotations

import atexit
import os
import re
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np

from lassokin_ros.core.errors import LassokinError
from lassokin_ros.video.camera import common_content, content_size

IMAGES = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp")
ASSUMED_FPS, HIGHEST_FPS = 30.0, 240.0
"""Hz: rate of a folder, and the highest that a video is believed to have. WebM of browsers says 1000: ticks per s."""
MOST_FPS = 1000.0
"""Hz: highest `--fps`."""
RAW = (".h264", ".264", ".avc", ".h265", ".265", ".hevc", ".mjpeg", ".mjpg")
"""Suffixes of files of images without a container. They have no times."""
LOOKED_AT = 10
"""Images whose times are looked at where the nominal rate is above HIGHEST_FPS."""
MOST_SLOW_MOTION = 100.0
LARGEST_PIXEL_RATIO = 3.0
"""Width of a pixel by its height, or the reverse, that is believed."""
SPREAD = (0.2, 0.4, 0.6, 0.8)
"""Places in a file, as shares, at which further images are looked at for black bars."""

STREAMS = ("rtsp", "rtsps", "rtmp", "http", "https", "udp", "tcp")
"""Schemes of addresses that OpenCV's FFmpeg opens."""
OPEN_TIMEOUT_MS, READ_TIMEOUT_MS = 10_000, 10_000
LAST_READ_S = 1.0
"""s: how long the end of a stream waits for the image that is being read. A stalled read ends with the process."""
DEVICES = Path("/dev")
FIRST_STAMP_NS = 1_000_000_000
"""ns: stamp of an image at 0 s. A stamp of zero means no stamp."""


class SourceError(LassokinError):
    """A source of images cannot be opened, or ends unexpectedly."""


@dataclass(frozen=True, eq=False)
class Image:
    """One image. seconds: since the first image, increasing. rgb: (height, width, 3) uint8."""

    seconds: float
    rgb: np.ndarray


@dataclass(frozen=True, eq=False)
class Source:
    """An open source. size: (width, height) px after rotation. fps: nominal, Hz. count: images, 0 = unknown.

    content: (width, height) px between black bars, see `content_size`.
    live: True for a camera, whose images show the moment at which they are read. begin: s, time of the first image in
    its file, as far as OpenCV tells it. remark: what is assumed of the times, in words; empty for nothing.
    `count` may be an estimate from duration and nominal rate, as in Matroska files with a variable rate.
    """

    name: str
    size: tuple[int, int]
    content: tuple[int, int]
    fps: float
    count: int
    images: Iterator[Image]
    live: bool = False
    begin: float = 0.0
    remark: str = ""

    @property
    def seconds(self) -> float:
        """The announced duration, s, from time 0 of the file; 0 = unknown."""
        return self.count / self.fps


@dataclass(frozen=True)
class Timing:
    """How the images of a file are timed. fps: Hz, in place of the file's own times; None = its own, a folder's 30 Hz.

    slow_motion: how many times slower the file plays than it was; times are divided by it. Raises SourceError.
    """

    fps: float | None = None
    slow_motion: float = 1.0

    def __post_init__(self) -> None:
        if self.fps is not None and not 0 < self.fps <= MOST_FPS:  # False for NaN
            raise SourceError(f"--fps {self.fps:g}; expected a rate above 0 and up to {MOST_FPS:g} Hz")
        if not 1 / MOST_SLOW_MOTION <= self.slow_motion <= MOST_SLOW_MOTION:
            raise SourceError(
                f"--slow-motion {self.slow_motion:g}; expected a factor, such as 8 for 240 Hz played at 30 Hz"
            )


def stamp_of(seconds: float) -> int:
    """Return the stamp of an image, ns. seconds: its time in the source."""
    return FIRST_STAMP_NS + round(seconds * 1e9)


def open_source(name: str, fps: float | None = None, slow_motion: float = 1.0) -> Source:
    """Open a video file, a webcam, a network stream or a folder of images. Raises SourceError.

    name: a path, the number of a webcam ("0"), its device ("/dev/video0", "/dev/v4l/by-id/..."), or an address
    ("rtsp://...", "http://..."). fps, slow_motion: see Timing; of files and folders only.
    """
    source = _open(name, Timing(fps, slow_motion))
    if (fps is not None or slow_motion != 1.0) and source.live:
        raise SourceError(f"{source.name} is live, so its images have the times at which they come; expected no --fps")
    return source


def _open(name: str, timing: Timing) -> Source:
    if name.isdecimal() and ((DEVICES / f"video{int(name)}").exists() or not os.path.exists(name)):
        return _webcam(int(name), f"camera {name}")
    if urlsplit(name).scheme.lower() in STREAMS and "://" in name:
        return _stream(name, timing)
    path = Path(name)
    if DEVICES in path.parents:
        return _webcam(_device_number(path), str(path))
    _check_name(path)
    if os.path.isdir(path):  # False for a name that is too long, for which Path.is_dir raises OSError
        return _folder(path, (timing.fps or ASSUMED_FPS) * timing.slow_motion)
    if not os.path.isfile(path):
        raise SourceError(f"there is no file or folder '{name}'")
    return _video(path, timing)


def _check_name(path: Path) -> None:
    """Raise SourceError for a name that ends OpenCV in a crash."""
    if not is_utf8(path):
        name = str(path).encode(errors="backslashreplace").decode()
        raise SourceError(f"the name '{name}' is not UTF-8, which OpenCV needs; rename the file")


def is_utf8(path: Path) -> bool:
    """Return whether the path can be written in UTF-8. Other bytes of a name are surrogates in Python's text."""
    return not any("\ud800" <= character <= "\udfff" for character in str(path))


def _video(path: Path, timing: Timing) -> Source:
    cv2 = _opencv()
    capture = cv2.VideoCapture(str(path))
    capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
    good, first = capture.read()
    if not good:
        raise SourceError(f"'{path}' has no video stream that OpenCV can read")
    first = _upright(cv2, capture, first)
    rate, count = _rate_and_count(cv2, capture)
    fault, remark = _fault_of_times(cv2, capture, path), ""
    if fault:
        count = max(int(capture.get(cv2.CAP_PROP_FRAME_COUNT)), 0)
    if fault and timing.fps is None:
        remark = f"'{path.name}' {fault}: {rate:g} images per second are assumed; set the rate by --fps"
        timing = Timing(rate, timing.slow_motion)
    size, content = (first.shape[1], first.shape[0]), common_content(first, _spread(cv2, path, count))
    # OpenCV 4.6 does not tell the time of the first image.
    ticks, own = (capture.get(getattr(cv2, name, -1)) for name in ("CAP_PROP_PTS", "CAP_PROP_FPS"))
    begin = max(ticks / own, 0.0) / timing.slow_motion if own > 0 and timing.fps is None else 0.0
    images, rate = _frames(cv2, capture, first, rate, timing), (timing.fps or rate) * timing.slow_motion
    return Source(path.name, size, content, rate, count, images, begin=begin, remark=remark)


def _fault_of_times(cv2: Any, capture: Any, path: Path) -> str:
    """Return why the times of a file cannot be those of its images, in words; empty if they can."""
    if path.suffix.lower() in RAW:
        return "has no times of its images"
    if not capture.get(cv2.CAP_PROP_FPS) > HIGHEST_FPS:
        return ""
    again: Any = cv2.VideoCapture(str(path))
    times: list[float] = []
    while len(times) < LOOKED_AT and again.grab():
        times.append(again.get(cv2.CAP_PROP_POS_MSEC) * 1e-3)
    again.release()
    period = float(np.median(np.diff(times))) if len(times) > 1 else 1.0
    if period >= 1 / HIGHEST_FPS:
        return ""
    return f"has {1 / period:.0f} images per second" if period > 0 else "has no times of its images"


def _spread(cv2: Any, path: Path, count: int) -> Iterator[np.ndarray]:
    """Yield some images spread over a video of `count` images, those that can be read."""
    capture = cv2.VideoCapture(str(path))
    capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
    try:
        for share in SPREAD:
            capture.set(cv2.CAP_PROP_POS_FRAMES, int(share * count))
            good, image = capture.read()
            if good:
                yield _upright(cv2, capture, image)
    finally:
        capture.release()


def _sizes(image: np.ndarray) -> tuple[tuple[int, int], tuple[int, int]]:
    return (image.shape[1], image.shape[0]), content_size(image)


def _rate_and_count(cv2: Any, capture: Any) -> tuple[float, int]:
    """Return the nominal rate, Hz, and the number of images, 0 = unknown. Both are assumed for an unlikely rate."""
    nominal, count = (float(capture.get(name)) for name in (cv2.CAP_PROP_FPS, cv2.CAP_PROP_FRAME_COUNT))
    if 1.0 <= nominal <= HIGHEST_FPS:
        return nominal, max(int(count), 0)
    return ASSUMED_FPS, max(int(count * ASSUMED_FPS / nominal if nominal > 0 else count), 0)


def _upright(cv2: Any, capture: Any, image: np.ndarray) -> np.ndarray:
    """Make the pixels of an image square, and rotate it, by the file's metadata.

    OpenCV 4.6 rotates in the wrong direction, and 4.11 by default not.
    """
    wide, high = capture.get(cv2.CAP_PROP_SAR_NUM), capture.get(cv2.CAP_PROP_SAR_DEN)
    ratio = wide / high if wide > 0 and high > 0 else 1.0
    if ratio != 1.0 and 1 / LARGEST_PIXEL_RATIO <= ratio <= LARGEST_PIXEL_RATIO:
        height, width = image.shape[:2]
        image = cv2.resize(image, (round(width * max(ratio, 1.0)), round(height * max(1 / ratio, 1.0))))
    degrees = round(capture.get(cv2.CAP_PROP_ORIENTATION_META)) * (-1 if cv2.__version__.startswith("4.6.") else 1)
    turns = {90: cv2.ROTATE_90_CLOCKWISE, 180: cv2.ROTATE_180, 270: cv2.ROTATE_90_COUNTERCLOCKWISE}
    turn = turns.get(degrees % 360)
    return image if turn is None else np.asarray(cv2.rotate(image, turn))


def _frames(cv2: Any, capture: Any, image: np.ndarray, rate: float, timing: Timing) -> Iterator[Image]:
    """Yield the images with the container's times, so that a variable frame rate is kept, or with those of `timing`."""
    last, origin, number = -1.0, None, 0
    try:
        while True:
            seconds = number / timing.fps if timing.fps else capture.get(cv2.CAP_PROP_POS_MSEC) * 1e-3
            number += 1
            origin = seconds if origin is None else origin
            seconds -= origin
            if last >= 0 and seconds <= last:  # the container has no times
                seconds = last + 1 / rate
            last = seconds
            yield Image(seconds / timing.slow_motion, cv2.cvtColor(image, cv2.COLOR_BGR2RGB))
            good, image = capture.read()
            if not good:
                return
            image = _upright(cv2, capture, image)
    finally:
        capture.release()


def _device_number(path: Path) -> int:
    """Return the number of a video device; by-id and by-path names are links to /dev/videoN."""
    found = re.fullmatch(r"video(\d+)", path.resolve().name)
    if not path.exists() or found is None:
        known = sorted(DEVICES.glob("video*"), key=lambda device: natural_key(device.name))
        listed = ", ".join(map(str, known)) or "none"
        raise SourceError(f"'{path}' is no camera; those of this machine: {listed}")
    return int(found.group(1))


def _stream(address: str, timing: Timing) -> Source:
    """Open an address: a live stream, or a file on a server, which has a number of images."""
    cv2, parts = _opencv(), urlsplit(address)
    name = parts._replace(netloc=parts.netloc.rpartition("@")[2]).geturl()  # without a password
    timeouts = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, OPEN_TIMEOUT_MS, cv2.CAP_PROP_READ_TIMEOUT_MSEC, READ_TIMEOUT_MS]
    capture: Any = cv2.VideoCapture(address, cv2.CAP_FFMPEG, timeouts)
    first: Any
    good, first = capture.read() if capture.isOpened() else (False, None)
    if not good:
        capture.release()
        raise SourceError(f"'{name}' gives no images: check the address, the password and that the camera is on")
    rate, count = _rate_and_count(cv2, capture)
    if count > 0:
        images = _frames(cv2, capture, first, rate, timing)
        return Source(name, *_sizes(first), (timing.fps or rate) * timing.slow_motion, count, images)
    return Source(name, *_sizes(first), rate, 0, _newest_images(cv2, capture, name), live=True)


def _newest_images(cv2: Any, capture: Any, name: str) -> Iterator[Image]:
    """Yield the newest image of a stream. A thread reads all, since unread images would wait and grow old.

    The thread ends before the interpreter does, also if this generator is never closed: a call of OpenCV that returns
    afterwards would abort the process.
    """
    arrived, ended = threading.Condition(), threading.Event()
    newest: list[tuple[float, np.ndarray]] = []

    def read() -> None:
        while not ended.is_set():
            good, image = capture.read()
            with arrived:
                if not good:
                    ended.set()
                else:
                    newest[:] = [(time.monotonic(), image)]
                arrived.notify()
        capture.release()

    thread = threading.Thread(target=read, daemon=True)

    def stop() -> None:
        ended.set()
        thread.join(LAST_READ_S)

    thread.start()
    atexit.register(stop)
    began = None
    try:
        while True:
            with arrived:
                arrived.wait_for(lambda: newest or ended.is_set())
                if not newest:
                    raise SourceError(f"'{name}' gives no more images")
                moment, image = newest.pop()
            began = moment if began is None else began
            yield Image(moment - began, cv2.cvtColor(image, cv2.COLOR_BGR2RGB))
    finally:
        stop()
        atexit.unregister(stop)


def _webcam(number: int, name: str) -> Source:
    cv2 = _opencv()
    capture: Any = cv2.VideoCapture(number)
    first: Any
    good, first = capture.read() if capture.isOpened() else (False, None)
    if not good:
        raise SourceError(f"{name} cannot be opened: it does not exist, or another program uses it")

    def images() -> Iterator[Image]:
        image, began = first, time.monotonic()
        try:
            while True:
                yield Image(time.monotonic() - began, cv2.cvtColor(image, cv2.COLOR_BGR2RGB))
                good, image = capture.read()
                if not good:
                    raise SourceError(f"{name} gives no more images")
        finally:
            capture.release()

    return Source(name, *_sizes(first), _rate_and_count(cv2, capture)[0], 0, images(), live=True)


def natural_key(name: str) -> list[tuple[str, int, str]]:
    """Return a sort key in which the numbers in a name count as numbers: 2.png is before 10.png."""
    parts = re.findall(r"(\D*)(\d*)", name.lower())
    return [(text, int(digits or -1), digits) for text, digits in parts]


def images_of(folder: Path) -> list[Path]:
    """Return the images in a folder, in no order, without hidden files: macOS writes `._walk.jpg` beside walk.jpg."""
    return [file for file in folder.iterdir() if file.suffix.lower() in IMAGES and not file.name.startswith(".")]


def _folder(path: Path, fps: float) -> Source:
    cv2 = _opencv()
    files = sorted(images_of(path), key=lambda file: natural_key(file.name))
    if not files:
        raise SourceError(f"the folder '{path}' has no images; expected {', '.join(IMAGES)}")
    for file in files:
        _check_name(file)
    first = cv2.imread(str(files[0]))
    if first is None:
        raise SourceError(f"'{files[0]}' is no image that OpenCV can read")

    def images() -> Iterator[Image]:
        for number, file in enumerate(files):
            image = cv2.imread(str(file))
            if image is None or image.shape != first.shape:
                problem = "is no image" if image is None else "has another size than the first image"
                raise SourceError(f"'{file}' {problem}")
            yield Image(number / fps, cv2.cvtColor(image, cv2.COLOR_BGR2RGB))

    others = (cv2.imread(str(files[int(share * len(files))])) for share in SPREAD)
    content = common_content(first, (image for image in others if image is not None))
    return Source(path.name, (first.shape[1], first.shape[0]), content, fps, len(files), images())


def _opencv() -> Any:
    try:
        import cv2
    except ImportError:
        raise SourceError("images are read with OpenCV; install it with: pip install opencv-python-headless") from None
    set_level: Any = getattr(cv2, "setLogLevel", None) or cv2.utils.logging.setLogLevel  # OpenCV 4 and 5
    set_level(0)  # errors are reported once, by SourceError
    return cv2
