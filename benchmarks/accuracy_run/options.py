"""The options of benchmarks/accuracy.py."""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.accuracy_run.experiment import METHODS
from benchmarks.common.option_types import count, finite, names, output_file, positive, seed, share, size
from benchmarks.data.depth_images import DepthCamera, DepthSensor
from benchmarks.data.simulated_camera import SWAPPED, Told
from lassokin_ros.core.config import TrackerConfig

SWITCH = {**dict.fromkeys(("true", "1", "yes", "on"), True), **dict.fromkeys(("false", "0", "no", "off"), False)}
GIVEN = {"height": "by each clip", "skeleton": "by each clip", "landmarks": "by --landmarks"}
"""Settings that --set does not accept, and the option to use instead."""
OF_DETECTIONS = (
    "detections methods measured_bones tracker_noise_px set joints uncertainty failure_probability jobs json".split()
)
"""Options that have an effect with --detections: its keypoints are used unchanged, from every camera."""


def parser(description: str | None = None) -> argparse.ArgumentParser:
    """The command line's options."""
    result = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    add, switch = result.add_argument, argparse.BooleanOptionalAction
    add("--data", type=Path, help="folder of clips (default: mocap/ in LASSOKIN_DATA or ../shared/data)")
    add("--detections", type=Path, nargs="+", metavar="FILE|DIR", help="real detector output (npz) instead of clips")
    add("--videos", type=Path, nargs="+", metavar="FILE|DIR", help="keypoints of videos, without any reference (npz)")
    _add_simulation(result)
    add("--landmarks", default="coco17", help="landmark layout (coco17)")
    add("--views", type=count, default=2, help="cameras per clip (2)")
    add("--seed", type=seed, default=0, help="of cameras, noise and bone errors (0)")
    add("--seeds", type=count, default=1, metavar="N", help="number of seeds, from --seed on, in one summary (1)")
    add("--methods", type=names, default=["lasso"], help=f"comma-separated, of {','.join(METHODS)} (lasso)")
    add("--clips", type=names, help="comma-separated names (default: all of no training)")
    people = result.add_mutually_exclusive_group()
    for name, meaning in (("test", "in no training set"), ("validation", "with which the design is chosen")):
        people.add_argument(f"--{name}-people", action="store_true", help=f"people {meaning} (--data: shared data)")
    add("--realistic", action="store_true", help="the usual case: a detector's errors, only the height given")
    add("--generic-skeleton", action="store_true", help="give only the person's height")
    add("--unknown-height", action="store_true", help="give not even the height: height 0, measured with depth")
    add("--measured-bones", action="store_true", help="with --detections: bone lengths of the reference")
    add("--bone-error", type=size, default=0.0, help="standard deviation of the given bones' relative error (0)")
    add("--symmetric", action=switch, default=True, help="the same bone error on both sides (default)")
    add("--score-from", type=size, default=0.0, metavar="S", help="score frames after S s, of clips that last (0)")
    add("--tracker-noise-px", type=float, help="noise_px of the methods (clips: --noise-px, 1 or more; detections: 3)")
    add("--set", type=setting, action="append", default=[], metavar="NAME=VALUE", help="any setting of the tracker")
    add("--initialisation", action="store_true", help="initialise from single frames spread over the clips")
    add("--per-clip", type=count, default=6, help="with --initialisation: frames per clip and view (6)")
    add("--gap", type=positive, metavar="S", help="no landmarks for S s in the middle of each clip")
    add("--joints", action="store_true", help="print the errors by joint too")
    add("--uncertainty", action="store_true", help="predicted and actual errors, in bins (--hidden: of these joints)")
    add("--rotations", action="store_true", help="with --uncertainty: of the joints' rotations, by joint; clips only")
    add("--failure-probability", action="store_true", help="stated against actual share of wrong poses, lasso only")
    add("--jobs", type=count, default=os.cpu_count(), help="processes (one per core)")
    add("--json", type=output_file, metavar="FILE", help="write the records as a JSON list")
    return result


def _add_simulation(parser: argparse.ArgumentParser) -> None:
    """Add the options of simulated cameras and detectors."""
    add, switch = parser.add_argument, argparse.BooleanOptionalAction
    add("--noise-px", type=size, default=2.0, help="Gaussian noise of a keypoint, px (2)")
    add("--wander-px", type=size, default=0.0, help="standard deviation of errors that last 0.1 s, px (0)")
    add("--offset-px", type=size, default=0.0, help="standard deviation of constant errors, px (0)")
    add("--landmark-mm", type=size, default=0.0, help="deviation of landmarks' places on the body over people, mm (0)")
    add("--peoples-proportions", action=switch, default=False, help="bodies drawn from people's, not the capture's own")
    add("--depth-noise", type=size, metavar="M", help="measured depth of each keypoint: Gaussian noise, m")
    add("--depth-bias", type=size, metavar="M", help="constant error of each landmark's depth, standard deviation, m")
    add("--depth-noise-z2", type=size, metavar="PER_M", help="depth noise that grows with the square of the depth, 1/m")
    add("--depth-occluded", type=share, metavar="SHARE", help="share of depths 10-50 cm nearer: an occluder")
    add("--depth-images", action="store_true", help="depth sampled from rendered images of a body of capsules")
    add("--depth-covered", type=share, metavar="SHARE", help="with --depth-images: share behind furniture, from below")
    add("--missing", type=share, default=0.0, help="share of keypoints missing, in bursts of 5-30 frames (0)")
    add("--outliers", type=share, default=0.0, help="share of keypoints 30-150 px off at full confidence (0)")
    add("--swaps", type=share, default=0.0, help="share of frames with a limb's left and right swapped, in bursts (0)")
    add("--swapped", choices=tuple(SWAPPED), default="limb", help="with --swaps: what is swapped (a limb per burst)")
    add("--swap-s", type=size, default=0.0, metavar="S", help="with --swaps: duration of a burst, s (1 to 12 frames)")
    add("--hidden", type=names, default=[], help="comma-separated landmarks that are never detected")
    add("--camera-roll", type=finite, default=0.0, metavar="RAD", help="true roll of the mount (0)")
    add("--camera-pitch", type=finite, default=0.0, metavar="RAD", help="true pitch of the mount (0)")
    add("--mount", choices=("tilt", "floor"), help="tell the tracker the true tilt; or this and the camera's height")
    add("--tilt-off", type=size, default=0.0, metavar="DEG", help="with --mount: error of the tilt told (0)")
    add("--floor-off", type=finite, default=0.0, metavar="M", help="with --mount floor: error of the height told (0)")
    add("--lying", action="store_true", help="people lie, on a random side")
    add("--fps", type=positive, default=60.0, help="frame rate, by leaving out frames; or the nearest there is (60)")


REALISTIC = {
    "noise_px": 1.5, "wander_px": 2.5, "offset_px": 2.5, "tracker_noise_px": 3.0, "generic_skeleton": True,
    "landmark_mm": 15.0, "peoples_proportions": True,
}  # fmt: skip
"""Values of --realistic: errors like those measured on real detectors, bodies like people's, only the height given."""


def parsed(description: str | None, arguments: Sequence[str] | None) -> argparse.Namespace:
    """The options. --realistic changes defaults, so that another option still counts."""
    own = parser(description)
    options = own.parse_args(arguments)
    if options.realistic:
        own.set_defaults(**REALISTIC)
        options = own.parse_args(arguments)
    if options.unknown_height:
        options.generic_skeleton = True
    return options


def depth_sensor(options: argparse.Namespace) -> DepthSensor | DepthCamera | None:
    """The depth sensor or depth camera with the given options; None if none of them is given."""
    o = options
    if o.depth_images:
        return DepthCamera(covered=o.depth_covered or 0.0)
    errors = o.depth_noise, o.depth_bias, o.depth_occluded, o.depth_noise_z2
    return None if errors == (None,) * 4 else DepthSensor(*(value or 0.0 for value in errors))


def told(options: argparse.Namespace) -> Told | None:
    """What the tracker is told of the camera's mount; None for nothing."""
    if options.mount is None:
        return None
    return Told(options.mount == "floor", math.radians(options.tilt_off), options.floor_off)


def given(options: argparse.Namespace) -> dict[str, Any]:
    """The options that differ from their defaults, by name, such as "--noise-px"."""
    defaults = vars(parser().parse_args([]))
    return {f"--{n.replace('_', '-')}": value for n, value in vars(options).items() if value != defaults[n]}


def unheeded(options: argparse.Namespace) -> list[str]:
    """The given options that have no effect together with --detections."""
    return [name for name in given(options) if name.removeprefix("--").replace("-", "_") not in OF_DETECTIONS]


def setting(text: str) -> tuple[str, Any]:
    """An option's type: NAME=VALUE, a setting of the tracker that is not given otherwise."""
    name, _, value = text.partition("=")
    if not hasattr(TrackerConfig(), name):
        raise argparse.ArgumentTypeError(f"the tracker has no setting '{name}'")
    if name in GIVEN:
        raise argparse.ArgumentTypeError(f"'{name}' is given {GIVEN[name]}")
    kind = type(getattr(TrackerConfig(), name))
    try:
        return name, SWITCH[value.lower()] if kind is bool else kind(value)
    except (KeyError, ValueError):
        raise argparse.ArgumentTypeError(f"{text}; expected a value of type {kind.__name__}") from None
