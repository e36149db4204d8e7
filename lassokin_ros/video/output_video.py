"""The output video: the image with keypoints and reprojected skeleton, beside the rotating skeleton in 3D."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from lassokin_ros.common.atomic_files import refuse_existing
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.errors import LassokinError
from lassokin_ros.pipeline.frame_result import FrameResult

HEIGHT = 720
"""px, at most."""
TURN_DEG_S = 30.0
METRES = 2.4
"""Height of the 3D view, m."""
KEYPOINT, BACKGROUND = (60, 220, 60), 24
SIDES = {"left": (255, 160, 60), "right": (40, 120, 255)}
MIDDLE = (210, 210, 210)
"""Colours, BGR; of the bones by side."""


class VideoError(LassokinError):
    """The output video cannot be written."""


class OutputVideo:
    """Writes one video. The file has its name only after `finish`."""

    def __init__(self, path: Path, size: tuple[int, int], fps: float, replace: bool) -> None:
        """size: (width, height) px of the images. Raises VideoError."""
        import cv2

        refuse_existing(path, replace, VideoError)
        if path.suffix.lower() not in (".mp4", ".avi"):
            raise VideoError(f"--video '{path}'; expected a name that ends in .mp4 or .avi")
        self._cv2, self._path, self._fps = cv2, path, fps
        self._scale = min(1.0, HEIGHT / size[1])
        self._size = max(round(size[0] * self._scale), 2), max(round(size[1] * self._scale), 2)
        even = (self._size[0] + self._size[1]) // 2 * 2, self._size[1] // 2 * 2
        self._even = even
        self._part = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
        self._writer = cv2.VideoWriter(str(self._part), cv2.VideoWriter.fourcc(*"mp4v"), fps, even)
        if not self._writer.isOpened():
            raise VideoError(f"'{path}' cannot be written by OpenCV")
        self._written = 0

    def add(self, seconds: float, rgb: np.ndarray, frames: list[FrameResult]) -> None:
        """Add an image with its results. It is repeated or left out to keep the frame rate constant."""
        target = round(seconds * self._fps) + 1
        if target <= self._written:
            return
        picture = self._picture(seconds, rgb, frames)
        while self._written < target:
            self._writer.write(picture)
            self._written += 1

    def _picture(self, seconds: float, rgb: np.ndarray, frames: list[FrameResult]) -> np.ndarray:
        cv2 = self._cv2
        left = cv2.resize(cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), self._size)
        right = np.full((self._size[1], self._size[1], 3), BACKGROUND, np.uint8)
        for frame in frames:
            if frame.accepted and frame.estimate is not None and frame.estimate.pose is not None and frame.skeleton:
                joints = frame.estimate.pose.positions
                self._bones(left, frame.in_image(joints) * self._scale, frame.skeleton)
                self._bones(right, self._turned(joints, seconds), frame.skeleton)
            if frame.detected is not None:
                for x, y in frame.detected[np.isfinite(frame.detected).all(axis=1)] * self._scale:
                    cv2.circle(left, (round(x), round(y)), 3, KEYPOINT, -1, cv2.LINE_AA)
        picture: np.ndarray = np.hstack([left, right])[: self._even[1], : self._even[0]]
        return np.ascontiguousarray(picture)

    def _turned(self, joints: np.ndarray, seconds: float) -> np.ndarray:
        """Rotate joints (n, 3) about the vertical axis through their centre; px of the 3D view."""
        angle = np.radians(TURN_DEG_S * seconds)
        centred = joints - (joints.min(axis=0) + joints.max(axis=0)) / 2
        x = np.cos(angle) * centred[:, 0] + np.sin(angle) * centred[:, 2]
        side = self._size[1]
        return np.stack([x, centred[:, 1]], axis=1) * side / METRES + side / 2

    def _bones(self, image: np.ndarray, points: np.ndarray, skeleton: Skeleton) -> None:
        limit = 4 * max(image.shape)
        for joint, parent in enumerate(skeleton.parents):
            ends = points[[parent, joint]]
            if parent >= 0 and (np.abs(ends) < limit).all():  # False for NaN
                first, second = ends.astype(int).tolist()
                colour = SIDES.get(skeleton.joint_names[joint].split("_")[0], MIDDLE)
                self._cv2.line(image, first, second, colour, 2, self._cv2.LINE_AA)

    def finish(self) -> None:
        """Close the file and give it its name. Raises VideoError."""
        self._writer.release()
        if not self._is_complete():
            raise VideoError(f"'{self._path}' cannot be written completely; is there room for it on the disk?")
        try:
            self._part.replace(self._path)
        except OSError as error:
            raise VideoError(f"'{self._path}' cannot be written: {error.strerror}") from None

    def _is_complete(self) -> bool:
        """Return whether the file has all images. OpenCV reports no error when it writes them."""
        video = self._cv2.VideoCapture(str(self._part))
        try:
            count = int(video.get(self._cv2.CAP_PROP_FRAME_COUNT)) if video.isOpened() else 0
            video.set(self._cv2.CAP_PROP_POS_FRAMES, max(count - 1, 0))
            return self._written == 0 or (count >= self._written and bool(video.grab()))
        finally:
            video.release()

    def discard(self) -> None:
        """Remove what was written, unless `finish` has run."""
        self._writer.release()
        self._part.unlink(missing_ok=True)
