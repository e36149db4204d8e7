"""benchmarks/cameras.py on a clip of the shared data: methods, conditions, figures."""

import json

import numpy as np
import pytest

from benchmarks.accuracy_run.people import test_clips as clips_of
from benchmarks.cameras import COLUMNS, METHODS, Job, main, parser, run
from benchmarks.common.report import data_folder

FOLDER, SHORT = data_folder(), ("--longest", "2.5")
pytestmark = pytest.mark.skipif(not (FOLDER / "mocap").is_dir(), reason="no motion capture: set LASSOKIN_DATA")


@pytest.fixture(scope="module")
def clip():
    """A clip of 4 s or more."""
    for file in clips_of(FOLDER):
        with np.load(file) as data:
            if 4.0 < len(data["joints"]) / data["fps"] < 8.0:
                return file
    raise AssertionError("no clip of 4 to 8 s among the test people's")


def figures(clip, *options):
    return {record["method"]: record for record in run(Job(clip, parser().parse_args([*SHORT, *options])))}


@pytest.fixture(scope="module")
def usual(clip):
    return figures(clip)


def test_all_methods_and_figures_of_two_cameras(clip, tmp_path, capsys):
    file = tmp_path / "records.json"
    assert main([*SHORT, "--clips", clip.stem, "--jobs", "1", "--json", str(file)]) == 0
    records = json.loads(file.read_text(encoding="utf-8"))
    assert tuple(record["method"] for record in records) == METHODS
    assert all(set(COLUMNS) - {"clips"} <= set(record) for record in records)
    table = capsys.readouterr().out
    assert all(column in table for column in COLUMNS) and "90 degrees apart" in table
    found = {record["method"]: record for record in records}
    assert all(record["mpjpe_mm"] < 60 for record in records)
    assert found["dlt offline"]["accel_error"] < found["dlt causal"]["accel_error"] < found["dlt"]["accel_error"]
    assert found["dlt causal"]["abs_mm"] > found["dlt offline"]["abs_mm"]  # it lags


@pytest.mark.parametrize(
    "condition, worse",
    [
        (["--extrinsics-error", "0.03,2"], {"lasso", "dlt"}),
        (["--late", "0.066"], {"lasso"}),  # triangulation waits
    ],
)
def test_each_condition_costs_accuracy(clip, usual, condition, worse):
    found = figures(clip, *condition)
    assert {name for name in ("lasso", "dlt") if found[name]["abs_mm"] > 1.2 * usual[name]["abs_mm"]} == worse


def test_cameras_that_run_freely_are_for_the_tracker_alone(clip):
    assert set(figures(clip, "--phase", "0.017")) == {"lasso"}
