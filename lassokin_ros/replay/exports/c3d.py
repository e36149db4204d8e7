"""Export C3D, the binary format of markers that most motion capture programs read: mm, z up."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, BinaryIO

import numpy as np

from lassokin_ros.replay.exports.errors import ExportError
from lassokin_ros.replay.exports.markers import markers_of
from lassokin_ros.replay.motion import Motion

Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""x to the camera's right, y away from the camera, z up, of the frame of `Markers`."""
MOST_FRAMES = 65535
"""Frames are counted in 16 bits; of more, readers return a part."""


def write_c3d(motion: Motion, file: BinaryIO) -> None:
    """Write one person's markers, in the world frame of `.amass.npz`; frame 1 is the recording's begin.

    Raises ExportError.
    """
    ezc3d = import_ezc3d()
    markers = markers_of(motion)
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
    places = 1e3 * (markers.positions @ Z_UP.T).transpose(2, 1, 0)  # (3, m, f)
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
