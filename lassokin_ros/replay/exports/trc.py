"""Export TRC, the text format of markers that OpenSim reads: m, y up."""

from __future__ import annotations

from typing import BinaryIO

import numpy as np

from lassokin_ros.replay.exports.markers import markers_of
from lassokin_ros.replay.motion import Motion

COLUMNS = "DataRate CameraRate NumFrames NumMarkers Units OrigDataRate OrigDataStartFrame OrigNumFrames"
BLOCK = 1000
"""Frames of which the text is in memory at once."""


def write_trc(motion: Motion, file: BinaryIO, name: str = "motion.trc") -> None:
    """Write one person's markers, see `Markers`; time 0 is the begin of the recording. Raises ExportError.

    name: of the file, which it contains.
    """
    markers = markers_of(motion)
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
