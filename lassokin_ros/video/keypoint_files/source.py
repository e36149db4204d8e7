"""A source of `lassokin track`: images and a detector, or a file of keypoints that stands for both."""

from __future__ import annotations

import argparse
import os
import re
from pathlib import Path

import numpy as np

from lassokin_ros.core.errors import CameraError
from lassokin_ros.detector.backend import Detector
from lassokin_ros.pipeline.camera.calibration_file import read_calibration
from lassokin_ros.video.keypoint_files.json_files import WITH_HANDS, openpose_files, read_openpose, read_results
from lassokin_ros.video.keypoint_files.keypoints import KeypointFile
from lassokin_ros.video.keypoint_files.tables import read_arrays, read_table
from lassokin_ros.video.sources import ASSUMED_FPS, Image, Source, SourceError, Timing, images_of, open_source

READERS = {".json": read_results, ".csv": read_table, ".npz": read_arrays}
"""Reader of a file by its suffix. A folder of JSON files without images is OpenPose's."""
PICKLED = (".pickle", ".pkl", ".h5")
"""Suffixes of keypoints that are not read. A pickle can run code, and a table of DeepLabCut is also written as CSV."""


def open_input(
    name: str, options: argparse.Namespace, size: tuple[int, int] = (0, 0)
) -> tuple[Source, Detector | None]:
    """Open images, or a file of keypoints with the detector that it stands for; None for images.

    size: (width, height) px of the images as a calibration has it, (0, 0) if it is not known. Raises SourceError.
    """
    path = Path(name)
    layouts = [setting.partition(":=")[2] for setting in options.p if setting.startswith("landmarks:=")]
    keypoints = _read(path, set(layouts) <= set(WITH_HANDS.values()))
    if keypoints is None:
        return open_source(name, options.fps, options.slow_motion), None
    if not any(map(len, keypoints.people)):
        raise SourceError(f"'{path}' has nobody in it")
    given = Timing(options.fps, options.slow_motion)
    size, count, remark = _size(options, keypoints, path, size), len(keypoints.people), ""
    if given.fps is None and keypoints.seconds is not None:
        seconds = keypoints.seconds / given.slow_motion
    else:
        if given.fps is None:
            remark = f"'{path.name}' has no times: {ASSUMED_FPS:g} images per second are assumed; set the rate by --fps"
        seconds = np.arange(count) / ((given.fps or ASSUMED_FPS) * given.slow_motion)
    period = float(np.median(np.diff(seconds))) if count > 1 else 1 / ASSUMED_FPS
    images = (Image(at, np.zeros((size[1], size[0], 3), np.uint8)) for at in seconds.tolist())
    source = Source(path.name, size, size, 1 / period, count, images, remark=remark)
    return source, keypoints.shown_at(seconds, size)


def _read(path: Path, hands: bool) -> KeypointFile | None:
    """Return the keypoints in a file or a folder, None if it has none. hands: see read_openpose. Raises SourceError."""
    suffix = path.suffix.lower()
    if os.path.isdir(path):
        return read_openpose(path, hands) if not images_of(path) and openpose_files(path) else None
    if not os.path.isfile(path):
        return None
    if suffix in PICKLED:
        raise SourceError(f"'{path}' holds objects of Python; expected keypoints as {', '.join(READERS)}")
    return READERS[suffix](path) if suffix in READERS else None


def _size(
    options: argparse.Namespace, keypoints: KeypointFile, path: Path, calibrated: tuple[int, int]
) -> tuple[int, int]:
    """Return the size of the images: --image-size, that of the calibration, or that in the file. Raises SourceError."""
    if options.image_size is not None:
        found = re.fullmatch(r"(\d{1,5})[x,](\d{1,5})", options.image_size)
        if found is None or 0 in (sides := (int(found[1]), int(found[2]))):
            raise SourceError(
                f"--image-size '{options.image_size}'; expected width and height in px, such as 1920x1080"
            )
        return sides
    if calibrated != (0, 0) or keypoints.size is not None:
        return keypoints.size if calibrated == (0, 0) and keypoints.size is not None else calibrated
    try:
        known = (0, 0) if options.camera_info is None else read_calibration(options.camera_info).size
    except CameraError:  # is said where the lens is read
        known = (0, 0)
    if known == (0, 0):
        raise SourceError(f"'{path}' does not say how large the images are; set --image-size, such as 1920x1080")
    return known
