"""Writes images to a video file: H.264, which browsers play, by PyAV; without PyAV what OpenCV's FFmpeg can encode.

The wheels of PyAV contain libx264. OpenCV's wheels can encode MPEG-4 part 2, which no browser plays, and VP9, which
takes ten times as long as H.264; OpenCV of Ubuntu has H.264.
"""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from lassokin_ros.core.errors import LassokinError

QUALITY, PRESET = 21, "veryfast"
"""Constant rate factor of libx264 (smaller is better), and its trade-off of time and size."""
LARGEST_DENOMINATOR = 1001
"""Frame rates are fractions such as 30000 / 1001."""


class VideoError(LassokinError):
    """The output video cannot be written."""


class Encoder(Protocol):
    """One video that is written."""

    browsers_play: bool
    """Whether browsers play the file."""

    def write(self, bgr: np.ndarray) -> None:
        """Add an image (height, width, 3), uint8."""

    def close(self) -> None:
        """End the file."""


def open_encoder(path: Path, size: tuple[int, int], fps: float) -> Encoder:
    """Return an encoder for a path that ends in .mp4 or .avi. size: (width, height) px, even. Raises VideoError."""
    try:
        import av
    except ImportError:
        return OpenCvEncoder(path, size, fps)
    return AvEncoder(av, path, size, fps)


class AvEncoder:
    """Writes H.264 by PyAV."""

    browsers_play = True

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
