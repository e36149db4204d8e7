"""Draw the README's animation: a balancing man with his keypoints, and the tracked body from the side.

    .venv/bin/python benchmarks/pictures/animation.py [--output docs/demo.gif]

Video and keypoints are the shared data's (LASSOKIN_DATA): the demo of Pose2Sim, BSD-3-Clause, Copyright (c) 2022,
perfanalytics; keypoints by MediaPipe. The pictures are those of `lassokin track --video`, at a third of the speed.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import numpy as np

from benchmarks.common.report import data_folder, exit_code
from lassokin_ros.detector.backend import Detected
from lassokin_ros.video.command import parser as track_options
from lassokin_ros.video.track import track

VIDEO, KEYPOINTS = "video/balancing_cam01.mp4", "detections/balancing_mediapipe_full.npz"
EVERY, FRAME_MS, COLOURS = 2, 100, 64
HEIGHT_PX = 270
LEFT, RIGHT = (0.12, 0.72, 0.0, 1.0), (0.18, 0.98, 0.14, 0.86)
"""First and last row and column of what is shown of the halves, as shares of their sizes."""


class Recorded:
    """A detector that returns the recorded keypoints of camera 0, in order."""

    landmarks, several = "mediapipe33", False

    def __init__(self, keypoints: np.ndarray) -> None:
        self._keypoints = iter(keypoints.astype(float))

    def detect(self, image: np.ndarray, seconds: float) -> list[Detected]:
        """See Detector.detect."""
        points = next(self._keypoints)
        return [Detected(points[:, :2], np.nan_to_num(points[:, 2]))]

    def close(self) -> None:
        """See Detector.close."""


def main() -> int:
    """Write the animation; the exit code."""
    options = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    options.add_argument("--output", type=Path, default=Path("docs/demo.gif"))
    output = options.parse_args().output
    files = [data_folder() / name for name in (VIDEO, KEYPOINTS)]
    if missing := [file for file in files if not file.is_file()]:
        raise SystemExit(f"no file {missing[0]}; expected the shared data (LASSOKIN_DATA)")
    with np.load(files[1]) as data:
        keypoints, K, size = data["kp2d"][0], data["K"][0], data["image_size"][0]
        height = float(data["stated_height"])
    fov = np.degrees(2 * np.arctan(max(size) / 2 / K[0, 0]))
    with TemporaryDirectory() as folder:
        video = Path(folder) / "out.mp4"
        track(
            track_options().parse_args([str(files[0]), f"--fov={fov}", f"--height={height}", f"--video={video}"]),
            Recorded(keypoints),
        )
        pictures = shown(video, size)
    save(pictures, output)
    print(f"{output}: {len(pictures)} pictures, {output.stat().st_size / 1000:.0f} kB")
    return 0


def shown(video: Path, size: Sequence[int]) -> list[np.ndarray]:
    """Return parts of every `EVERY`-th picture of a video, RGB. size: (width, height) px of the source's images."""
    import cv2

    source, pictures = cv2.VideoCapture(str(video)), []
    while True:
        there, picture = source.read()
        if not there:
            return pictures[::EVERY]
        rgb = cv2.cvtColor(picture, cv2.COLOR_BGR2RGB)
        height = round(rgb.shape[1] * size[1] / sum(size))  # beside a square of this height; a line of text below both
        halves = (rgb[:height, :-height], LEFT), (rgb[:height, -height:], RIGHT)
        pictures.append(np.hstack([_part(cv2, half, *place) for half, place in halves]))


def _part(cv2: Any, picture: np.ndarray, top: float, bottom: float, left: float, right: float) -> np.ndarray:
    rows, columns = picture.shape[:2]
    part = picture[round(top * rows) : round(bottom * rows), round(left * columns) : round(right * columns)]
    width = round(HEIGHT_PX * part.shape[1] / part.shape[0])
    return np.asarray(cv2.resize(part, (width, HEIGHT_PX), interpolation=cv2.INTER_AREA))


def save(pictures: list[np.ndarray], output: Path) -> None:
    """Write a GIF with one palette for all pictures."""
    from PIL import Image

    palette = Image.fromarray(np.vstack(pictures[:: max(len(pictures) // 4, 1)])).quantize(COLOURS)
    frames = [Image.fromarray(one).quantize(palette=palette, dither=Image.Dither.NONE) for one in pictures]
    frames[0].save(output, save_all=True, append_images=frames[1:], duration=FRAME_MS, loop=0, optimize=True)


if __name__ == "__main__":
    sys.exit(exit_code(main))
