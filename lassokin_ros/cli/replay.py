"""The command `lassokin replay`: run the tracker over one recording, or over an archive of recordings."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from lassokin_ros.common.command_line import print_note, print_summary, run_command
from lassokin_ros.replay import PROGRAM
from lassokin_ros.replay.bags import STORAGES

BAG = "rosbag2 folder, .mcap or .db3 file, or folder of recordings; several recordings are an archive"
CALIBRATION = (
    "calibration file that replaces camera_info of the recording: ost.yaml of ROS, YAML of OpenCV, a camchain of "
    "Kalibr, or TOML of Pose2Sim, Anipose or caliscope (camchain.yaml:cam1 for one of several cameras)"
)
OUTPUT = (
    "recording to write (default: <bag>_tracked in the current folder); for an archive: the folder of all <bag>_tracked"
)
TWO_PASS = "learn each person's lengths over the whole recording, then track with them backward and forward in time"
REPORT = "write an HTML page with plots and the skeleton in 3D; for an archive: a folder of pages"
EXPORT = (
    "also write the motion to a .csv, .npz, .bvh, .amass.npz, .trc, .c3d or .glb file; a suffix alone writes into the "
    "output folder"
)
SKELETON = "write the calibrated skeleton at the end; with several people one file per person, with _<id> added"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code.

    The code is 0 on success, 2 for input that cannot be used (with one line on stderr), and 130 after an interrupt.
    """
    options = parser().parse_args(arguments)
    if options.height is not None:
        options.p.append(f"height:={options.height}")
    return run_command(PROGRAM, lambda: run(options))


def run(options: argparse.Namespace) -> int:
    """Replay one recording or an archive, and return the exit code. Raises a LassokinError."""
    from lassokin_ros.archive.archive import is_archive, replay_archive
    from lassokin_ros.replay.replay import replay

    if is_archive(options):
        return replay_archive(options)
    (options.bag,) = options.bags
    replayed = replay(options)
    print_summary(replayed.summary)
    if replayed.warning:
        print_note(f"{PROGRAM}: {replayed.warning}")
    return 0


def parser() -> argparse.ArgumentParser:
    """Return the argument parser."""
    title = "Track the keypoints of a rosbag2 recording and write the node's topics to another one."
    result = argparse.ArgumentParser(prog=PROGRAM, description=title)
    add = result.add_argument
    add("bags", type=Path, nargs="+", metavar="BAG", help=BAG)
    add("--params-file", type=Path, action="append", default=[], metavar="YAML", help="ROS parameter file")
    add("-p", action="append", default=[], metavar="name:=value", help="set a parameter of the tracker")
    add("--height", type=float, metavar="M", help="height of the person, m (same as -p height:=...)")
    add("--keypoints-topic", metavar="TOPIC", help="needed if the recording has several")
    add("--camera-info-topic", metavar="TOPIC", help="needed if the recording has several")
    add("--image-topic", metavar="TOPIC", help="images of each camera, shown in the report under the image plane")
    add("--camera-info", type=Path, metavar="FILE", help=CALIBRATION)
    add("--output", "-o", type=Path, help=OUTPUT)
    add("--two-pass", action="store_true", help=TWO_PASS)
    add("--storage", choices=STORAGES, help="storage of the output (default: that of the input)")
    add("--report", type=Path, metavar="HTML", help=REPORT)
    add("--export", type=Path, action="append", default=[], metavar="FILE", help=EXPORT)
    add("--save-skeleton", type=Path, metavar="YAML", help=SKELETON)
    add("--force", action="store_true", help="replace existing outputs")
    add("--jobs", type=_positive, metavar="N", help="number of processes for an archive (default: one per core)")
    add("--scheduler", metavar="ADDRESS", help="dask.distributed scheduler (address or file)")
    return result


def _positive(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"'{text}'; expected a whole number, 1 or more")
    return int(text)


if __name__ == "__main__":
    sys.exit(main())
