"""The images of a recording for the page: JPEG, scaled down, and thinned to a limit."""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

LONGEST_SIDE = 640
"""px"""
QUALITY = 70
"""JPEG quality."""
MOST, BUDGET = 300, 6_000_000
"""Largest number of images, and bytes before base64 (which adds a third).

Above either, every second image is removed.
"""


class ReportImages:
    """Images in order of arrival. Of a long recording every n-th is kept."""

    def __init__(self) -> None:
        self._images: dict[int, bytes] = {}
        self._stride, self._count = 1, 0

    def add(self, stamp_ns: int, read: Callable[[], np.ndarray]) -> None:
        """Add an image. read: returns it, (height, width, 3) uint8 RGB; called only if the image is kept."""
        if self._count % self._stride == 0:
            self._images[stamp_ns] = jpeg(read())
        self._count += 1
        while len(self._images) > MOST or sum(map(len, self._images.values())) > BUDGET:
            self._images = dict(list(self._images.items())[::2])
            self._stride *= 2

    def move(self, moved: Callable[[int], int]) -> None:
        """Give the images other stamps. moved: returns the new stamp of an old one, ns."""
        self._images = {moved(stamp_ns): image for stamp_ns, image in self._images.items()}

    def data(self, times: Mapping[int, float], apart_ns: int = 0) -> dict[str, Any]:
        """Return the data for the page. times: s on the page's axis by stamp in ns; images without a time are left out.

        apart_ns: ns by which the stamp of an image may differ. time: of each image, increasing. jpeg: base64 of each.
        """
        stamps = np.array(sorted(times), dtype=np.int64)
        near = {stamp: stamps[np.argmin(np.abs(stamps - stamp))] for stamp in self._images} if len(stamps) else {}
        known = sorted((times[int(k)], self._images[s]) for s, k in near.items() if abs(int(k) - s) <= apart_ns)
        return {
            "time": [round(time, 4) for time, _ in known],
            "jpeg": [base64.b64encode(image).decode() for _, image in known],
        }


def jpeg(rgb: np.ndarray) -> bytes:
    """Return an image (height, width, 3), uint8 RGB, as JPEG, scaled down to LONGEST_SIDE."""
    import cv2

    scale = LONGEST_SIDE / max(rgb.shape[:2])
    if scale < 1.0:
        size = max(round(rgb.shape[1] * scale), 1), max(round(rgb.shape[0] * scale), 1)
        rgb = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA)
    _, data = cv2.imencode(".jpg", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    return bytes(data)
