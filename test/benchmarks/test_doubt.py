"""benchmarks/accuracy_run/doubt.py prints a line for each camera, and totals."""

import numpy as np
import pytest

from benchmarks.accuracy_run.doubt import main, totals
from benchmarks.common.report import data_folder


def test_totals_count_frames_and_recordings():
    def one(error, marks, says):
        error = np.array(error, dtype=float)
        over = float(np.mean(error[np.isfinite(error)] > 150))
        return {"error": error, "marks": np.array(marks), "says": says, "over_150": over, "mpjpe_mm": 1.0,
                "wrist_shake_mm": 2.0, "ankle_shake_mm": 3.0}  # fmt: skip

    records = [one([50, 55, 160, np.nan], [0, 1, 1, 1], "doubt"), one([40] * 4, [0] * 4, ""), one([200], [0], "")]
    lines = totals([{**record, "marks": record["marks"].astype(bool)} for record in records])
    assert [line.rpartition(": ")[2] for line in lines] == [
        "1.0 mm, wrists 2.0 mm, ankles 3.0 mm",
        "2 of 9",
        "50%",
        "83.3%",
        "1 of 2",
        "0 of 1",
    ]
    assert totals([{**records[1], "marks": np.zeros(4, dtype=bool)}])[2].endswith("marked: there are none")


def test_a_recording_is_measured(capsys):
    file = data_folder() / "detections" / "talking_woman_movenet_lightning.npz"
    if not file.is_file():
        pytest.skip("LASSOKIN_DATA has no detections")
    main([str(file)])
    printed = capsys.readouterr().out
    assert printed.count("talking_woman_movenet_lightning:") == 2 and "good recordings with a doubt" in printed
