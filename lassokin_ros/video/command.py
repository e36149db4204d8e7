"""The command `lassokin track`: a video, a webcam or images to a skeleton, without ROS."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from lassokin_ros.common.command_line import INTERRUPTED, USAGE_ERROR, print_note, print_summary, run_command
from lassokin_ros.core.errors import CameraError
from lassokin_ros.video import PROGRAM

QUIET = {"OPENCV_FFMPEG_LOGLEVEL": "-8", "RUST_LOG": "off"}
"""Environment variables that keep libraries (FFmpeg, Rerun) from writing to stderr beside our line."""
WINDOW = Path()
"""Value of --view without a file."""
SOURCES = """video file, folder of images, number or device of a webcam, address of a stream (rtsp://, http://), or
keypoints: JSON of OpenPose (folder), AlphaPose or COCO, a table of DeepLabCut or MediaPipe, .npz"""
CAMERAS = """lenses and poses of the cameras of several videos: TOML of Pose2Sim, Anipose or caliscope, a camchain of
Kalibr, OpenCV's stereo calibration, files of Panoptic or Qualisys, a folder of EasyMocap or OpenCap; without it, the
places are found from the person"""
PERSON = """with a detector that finds several people: largest (default for files), nearest, all, or a number of the
list that is printed, 1 for the largest"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code.

    The code is 0 on success, 2 for input that cannot be used (with one line on stderr), and 130 if a video was
    interrupted. If the source ends early, or is interrupted, the files hold the part that was tracked.
    """
    options = parser().parse_args(arguments)
    for name, level in QUIET.items():
        os.environ.setdefault(name, level)
    return run_command(PROGRAM, lambda: run(options))


def run(options: argparse.Namespace) -> int:
    """Track, print the summary and return the exit code. Raises a LassokinError."""
    from lassokin_ros.video.run_settings import check_output_paths
    from lassokin_ros.video.track import track

    several = len(options.sources) > 1 or options.cameras is not None
    if options.save_cameras is not None and not several:
        raise CameraError("--save-cameras is for several videos; expected two or more")
    if options.offsets is not None and len(options.sources) < 2:
        raise CameraError("--offsets is for several videos; expected two or more")
    check_output_paths(options)
    tracked = track(options)
    print_summary(tracked.summary)
    if tracked.fault:
        print_note(f"{PROGRAM}: {tracked.fault}; what was tracked until then is kept")
        return USAGE_ERROR
    return 0 if tracked.complete else INTERRUPTED


def parser() -> argparse.ArgumentParser:
    """Return the parser of the options."""
    result = argparse.ArgumentParser(prog=PROGRAM, description="Track a person in a video, without ROS.")
    _add_inputs(result.add_argument)
    _add_outputs(result.add_argument)
    return result


def _add_inputs(add: Callable[..., object]) -> None:
    """Add the options of videos, cameras and people."""
    add("sources", nargs="+", metavar="VIDEO|0|IMAGES", help=SOURCES)
    add("--height", type=float, help="height of the person, m (same as -p height:=...)")
    add("--fov", type=float, metavar="DEG", help="field of view along the longer side of the image")
    add("--image-size", metavar="WxH", help="size of the images of a file of keypoints, px")
    add("--fisheye", action="store_true", help="--fov is that of a fisheye lens")
    add("--camera-info", type=Path, metavar="YAML", help="calibration file of ROS (ost.yaml), OpenCV or Kalibr")
    add("--cameras", type=Path, metavar="FILE", help=CAMERAS)
    saved = "write lenses and places of several cameras, for --cameras"
    add("--save-cameras", type=Path, metavar="TOML", help=saved)
    offsets = "s by which each of several videos begins after the first one; without it, they are found from the person"
    add("--offsets", metavar="S,S,...", help=offsets)
    names = "mediapipe (default), mediapipe_hands, or a .task or .onnx file"
    add("--detector", default="mediapipe", metavar="NAME", help=names)
    hands = "track fingers, too; short for --detector mediapipe_hands"
    add("--hands", dest="detector", action="store_const", const="mediapipe_hands", help=hands)
    add("--person", metavar="WHO", help=PERSON)
    rate = "images per second, in place of a file's own times (of a folder of images: 30 Hz)"
    add("--fps", type=float, help=rate)
    slower = "how many times slower the file plays than it was"
    add("--slow-motion", type=float, default=1.0, metavar="FACTOR", help=slower)
    add("--params-file", type=Path, action="append", default=[], metavar="YAML")
    add("-p", action="append", default=[], metavar="name:=value", help="a parameter of the tracker")
    causal = "track a file as a camera's images: in one pass, without smoothing by later frames"
    add("--causal", action="store_true", help=causal)


def _add_outputs(add: Callable[..., object]) -> None:
    """Add the options of files that are written."""
    add("--report", type=Path, metavar="HTML", help="write a page with plots and the skeleton in 3D")
    forms = ".csv, .npz, .bvh, .amass.npz, .trc, .c3d or .glb"
    add("--export", type=Path, action="append", default=[], metavar="FILE", help=forms)
    add("--video", type=Path, metavar="MP4", help="write the images with the skeleton as a video")
    view = "show all in the viewer Rerun, or record it for it"
    add("--view", nargs="?", type=Path, const=WINDOW, metavar="RRD", help=view)
    add("--force", action="store_true", help="replace outputs that exist")


if __name__ == "__main__":
    sys.exit(main())
