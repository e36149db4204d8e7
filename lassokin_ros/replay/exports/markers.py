"""Export the body as markers, for biomechanics: TRC, the text format that OpenSim reads, and C3D, a binary format.

The markers are the points of Halpe-26 with the names of Pose2Sim's OpenSim model. Pose2Sim's marker set and inverse
kinematics `Halpe26` take these names, so its scaling and OpenSim's read the files.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, BinaryIO

import numpy as np

from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.errors import LayoutError
from lassokin_ros.replay.exports.sampling import Y_UP, Z_UP, ExportError, uniform
from lassokin_ros.replay.motion import Motion

LAYOUT = "halpe26"
NAMES = {"mid_hip": "Hip", "head_top": "Head"}
"""Names of Pose2Sim that do not follow the rule `left_big_toe` to `LBigToe`."""
SIDES = {"left": "L", "right": "R"}


@dataclass(frozen=True, eq=False)
class Markers:
    """Markers at a constant rate in a world of `sampling`. period: s. positions: (f, m, 3) m.

    start: s from the begin of the recording to the first frame.
    """

    period: float
    names: tuple[str, ...]
    positions: np.ndarray
    start: float = 0.0


def markers_of(motion: Motion, world: np.ndarray) -> Markers:
    """Return the markers of one person. Raises ExportError, see `uniform` and `marker_layout`."""
    layout = marker_layout(motion.skeleton)
    track = uniform(motion, world)
    points = Kinematics(motion.skeleton, layout).pose(BodyState(track.rotations, track.translations)).landmarks
    return Markers(track.period, tuple(map(marker_name, layout.names)), points, motion.start)


def marker_layout(skeleton: Skeleton) -> Layout:
    """Return the places of the markers on a skeleton. Raises ExportError for a skeleton without these points."""
    try:
        return Layout.load(LAYOUT, skeleton)
    except LayoutError as error:
        raise ExportError(f"a .trc or .c3d file needs the points of {LAYOUT}: {error}; export .csv or .npz") from None


def marker_name(landmark: str) -> str:
    """Return Pose2Sim's name of a landmark: `left_big_toe` is LBigToe."""
    if landmark in NAMES:
        return NAMES[landmark]
    return "".join(SIDES.get(word, word.capitalize()) for word in landmark.split("_"))


COLUMNS = "DataRate CameraRate NumFrames NumMarkers Units OrigDataRate OrigDataStartFrame OrigNumFrames"
BLOCK = 1000
"""Frames of which the text is in memory at once."""


def write_trc(motion: Motion, file: BinaryIO, name: str = "motion.trc") -> None:
    """Write one person's markers, y up; time 0 is the begin of the recording. Raises ExportError.

    name: of the file, which it contains.
    """
    markers = markers_of(motion, Y_UP)
    frames, count = markers.positions.shape[:2]
    rate = f"{1 / markers.period:.6f}"
    axes = "\t".join(f"X{i}\tY{i}\tZ{i}" for i in range(1, count + 1))
    header = [
        f"PathFileType\t4\t(X/Y/Z)\t{name}",
        COLUMNS.replace(" ", "\t"),
        "\t".join([rate, rate, str(frames), str(count), "m", rate, "1", str(frames)]),
        "Frame#\tTime\t" + "\t\t\t".join(markers.names) + "\t\t",
        f"\t\t{axes}",
        "",
    ]
    file.write(("\n".join(header) + "\n").encode(errors="backslashreplace"))
    numbers = np.arange(frames)
    table = np.column_stack(
        [numbers + 1, markers.start + numbers * markers.period, markers.positions.reshape(frames, -1)]
    )
    for begin in range(0, frames, BLOCK):
        np.savetxt(file, table[begin : begin + BLOCK], fmt=["%d"] + ["%.6f"] * (1 + 3 * count), delimiter="\t")


MOST_FRAMES = 65535
"""Frames are counted in 16 bits; of more, readers return a part."""


def write_c3d(motion: Motion, file: BinaryIO) -> None:
    """Write one person's markers, in the world frame of `.amass.npz`; frame 1 is the recording's begin.

    Raises ExportError.
    """
    ezc3d = import_ezc3d()
    markers = markers_of(motion, Z_UP)
    first = round(markers.start / markers.period)
    last = first + len(markers.positions)
    if last > MOST_FRAMES:
        raise ExportError(
            f"a .c3d file counts up to {MOST_FRAMES} frames, the motion has {last}; expected .trc "
            "or a shorter part of the recording"
        )
    data = ezc3d.c3d()
    points = data["parameters"]["POINT"]
    points["RATE"]["value"] = [1 / markers.period]
    points["UNITS"]["value"] = ["mm"]
    points["LABELS"]["value"] = list(markers.names)
    places = 1e3 * markers.positions.transpose(2, 1, 0)  # (3, m, f)
    data["header"]["points"]["first_frame"] = first
    data["data"]["points"] = np.concatenate([places, np.ones((1, *places.shape[1:]))])
    with TemporaryDirectory(prefix="lassokin_") as folder:  # ezc3d writes to paths only
        path = Path(folder) / "motion.c3d"
        data.write(str(path))
        file.write(path.read_bytes())


def import_ezc3d() -> Any:
    """Return the module ezc3d. Raises ExportError if it is not installed."""
    try:
        import ezc3d
    except ImportError:
        raise ExportError("a .c3d file needs ezc3d; install it with: pip install ezc3d") from None
    return ezc3d
