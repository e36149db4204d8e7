"""The command line options of `lassokin replay`."""

from __future__ import annotations

import argparse
from pathlib import Path

from lassokin_ros.replay.bags import STORAGES

PROGRAM = "lassokin replay"
"""What users type; it starts each message. `ros2 run lassokin_ros replay` is the same command."""


def parser() -> argparse.ArgumentParser:
    """Return the argument parser."""
    result = argparse.ArgumentParser(
        prog=PROGRAM,
        description="Track the keypoints of a rosbag2 recording and write the node's topics to another one.",
    )
    _add_inputs(result)
    _add_outputs(result)
    result.add_argument(
        "--jobs", type=_positive, metavar="N", help="number of processes for an archive (default: one per core)"
    )
    result.add_argument("--scheduler", metavar="ADDRESS", help="dask.distributed scheduler (address or file)")
    return result


def _add_inputs(result: argparse.ArgumentParser) -> None:
    result.add_argument(
        "bags",
        type=Path,
        nargs="+",
        metavar="BAG",
        help="rosbag2 folder, .mcap or .db3 file, or folder of recordings; several recordings are an archive",
    )
    result.add_argument(
        "--params-file", type=Path, action="append", default=[], metavar="YAML", help="ROS parameter file"
    )
    result.add_argument("-p", action="append", default=[], metavar="name:=value", help="set a parameter of the tracker")
    result.add_argument("--height", type=float, metavar="M", help="height of the person, m (same as -p height:=...)")
    result.add_argument("--keypoints-topic", metavar="TOPIC", help="needed if the recording has several")
    result.add_argument("--camera-info-topic", metavar="TOPIC", help="needed if the recording has several")
    result.add_argument(
        "--image-topic", metavar="TOPIC", help="images of each camera, shown in the report under the image plane"
    )
    result.add_argument(
        "--camera-info",
        type=Path,
        metavar="FILE",
        help="calibration file that replaces camera_info of the recording: ost.yaml of ROS, YAML of OpenCV, a "
        "camchain of Kalibr, or TOML of Pose2Sim, Anipose or caliscope (camchain.yaml:cam1 for one of several cameras)",
    )


def _add_outputs(result: argparse.ArgumentParser) -> None:
    result.add_argument(
        "--output",
        "-o",
        type=Path,
        help="recording to write (default: <bag>_tracked in the current folder); for an archive: the folder of all "
        "<bag>_tracked",
    )
    result.add_argument(
        "--two-pass",
        action="store_true",
        help="learn each person's lengths over the whole recording, then track with them backward and forward in time",
    )
    result.add_argument("--storage", choices=STORAGES, help="storage of the output (default: that of the input)")
    result.add_argument(
        "--report",
        type=Path,
        metavar="HTML",
        help="write an HTML page with plots and the skeleton in 3D; for an archive: a folder of pages",
    )
    result.add_argument(
        "--export",
        type=Path,
        action="append",
        default=[],
        metavar="FILE",
        help="also write the motion to a .csv, .npz, .bvh, .amass.npz, .trc, .c3d or .glb file; a suffix alone writes "
        "into the output folder",
    )
    result.add_argument(
        "--save-skeleton",
        type=Path,
        metavar="YAML",
        help="write the calibrated skeleton at the end; with several people one file per person, with _<id> added",
    )
    result.add_argument("--force", action="store_true", help="replace existing outputs")


def _positive(text: str) -> int:
    try:
        number = int(text)
    except ValueError:
        number = 0
    if number < 1:
        raise argparse.ArgumentTypeError(f"'{text}'; expected a whole number, 1 or more")
    return number
