"""The people of validation and of the test in benchmarks/accuracy.py: their clips, and a table by person."""

import json

import pytest

from benchmarks.accuracy import clip_files, main
from benchmarks.accuracy_run.options import parser
from benchmarks.accuracy_run.people import person_of, seen_by_network
from benchmarks.accuracy_run.table import COLUMNS, person_table
from benchmarks.common.report import data_folder
from training.motion import TEST, VALIDATION
from training.pose_prior import SEEN

needs_data = pytest.mark.skipif(
    not (data_folder() / "corpus").is_dir(), reason=f"no corpus in {data_folder()}: set LASSOKIN_DATA"
)


@needs_data
@pytest.mark.parametrize("option, people", [("--validation-people", VALIDATION), ("--test-people", TEST)])
def test_only_clips_of_these_people_are_run_and_none_that_was_trained_with(option, people):
    files = clip_files(parser().parse_args([option]))
    assert {person_of(file) for file in files} == set(people)
    assert not any(seen_by_network(file) for file in files)
    assert {file.stem for file in files}.isdisjoint(SEEN)


@needs_data
def test_the_table_by_person_follows_the_summary(monkeypatch, tmp_path, capsys):
    files = [file for file in clip_files(parser().parse_args(["--validation-people"])) if "mx_09_0" in file.stem][:2]
    monkeypatch.setattr("benchmarks.accuracy.validation_clips", lambda folder: files)
    output = tmp_path / "records.json"
    options = ["--validation-people", "--realistic", "--views", "1", "--jobs", "1", "--fps", "30"]
    assert main([*options, "--json", str(output)]) == 0
    records = json.loads(output.read_text(encoding="utf-8"))
    assert [r["person"] for r in records] == ["09", "09"]
    assert "mean of people" in capsys.readouterr().out


def test_the_mean_of_people_does_not_depend_on_their_number_of_clips():
    def record(person, value):
        return {"method": "lasso", "person": person, **dict.fromkeys(COLUMNS, value)}

    lines = person_table([record("A", 10.0), record("A", 20.0), record("A", 30.0), record("B", 60.0)], COLUMNS)
    rows = {line.split()[1]: line.split() for line in lines.splitlines()[2:]}
    assert rows["A"][3] == "20.0" and rows["B"][3] == "60.0"
    assert rows["mean"][5] == "40.0"
