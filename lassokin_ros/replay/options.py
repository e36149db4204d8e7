"""The options of the command `replay`."""

from __future__ import annotations

import argparse
from pathlib import Path

from lassokin_ros.replay.bags import STORAGES


def parser() -> argparse.ArgumentParser:
    """What is read, by which parameters, what is written, and on what it runs."""
    result = argparse.ArgumentParser(
        prog="replay",
        description="Track the keypoints of a rosbag2 recording and write the node's topics to another one.",
    )
    _add_inputs(result)
    _add_outputs(result)
    result.add_argument(
        "--jobs", type=_positive, metavar="N", help="processes for an archive (default: one for each core)"
    )
    result.add_argument("--scheduler", metavar="ADDRESS", help="of dask.distributed, or its scheduler file")
    return result


def _add_inputs(result: argparse.ArgumentParser) -> None:
    result.add_argument(
        "bags",
        type=Path,
        nargs="+",
        metavar="BAG",
        help="rosbag2 folder, a single .mcap or .db3 file, or a folder of recordings; several are an archive",
    )
    result.add_argument(
        "--params-file", type=Path, action="append", default=[], metavar="YAML", help="ROS parameter file"
    )
    result.add_argument("-p", action="append", default=[], metavar="name:=value", help="a parameter, as of the node")
    result.add_argument("--keypoints-topic", metavar="TOPIC", help="needed when the recording has several")
    result.add_argument("--camera-info-topic", metavar="TOPIC", help="needed when the recording has several")


def _add_outputs(result: argparse.ArgumentParser) -> None:
    result.add_argument(
        "--output",
        "-o",
        type=Path,
        help="recording to write (default: <bag>_tracked, here); for an archive the folder of all <bag>_tracked",
    )
    result.add_argument("--storage", choices=STORAGES, help="of the output (default: the input's)")
    result.add_argument(
        "--report",
        type=Path,
        metavar="HTML",
        help="write a page with plots and the skeleton in 3D, for a browser; of an archive: a folder of pages",
    )
    result.add_argument(
        "--export",
        type=Path,
        action="append",
        default=[],
        metavar="FILE",
        help="write the motion to a .csv, .npz, .bvh or .amass.npz too; a suffix alone: into the output's folder",
    )
    result.add_argument(
        "--save-skeleton",
        type=Path,
        metavar="YAML",
        help="write the calibrated skeleton of who is there at the end; of several people each their own, _<id> added",
    )
    result.add_argument("--force", action="store_true", help="replace an output that exists")


def _positive(text: str) -> int:
    try:
        number = int(text)
    except ValueError:
        number = 0
    if number < 1:
        raise argparse.ArgumentTypeError(f"'{text}'; expected a whole number, 1 or more")
    return number
