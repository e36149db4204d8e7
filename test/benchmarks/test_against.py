"""benchmarks/against.py: two revisions in two processes, the same frames, ratios."""

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest

from benchmarks import against
from benchmarks.common.refusals import exit_code
from benchmarks.timing.revision import checked_out

in_git = pytest.mark.skipif(
    subprocess.run(["git", "rev-parse", "HEAD"], cwd=against.ROOT, capture_output=True).returncode != 0,
    reason="not a git checkout",
)


@in_git
def test_this_revision_against_head(tmp_path, capsys):
    file = tmp_path / "records.json"
    options = ["HEAD", "--data", str(tmp_path), "--rounds", "1", "--parts", "step,first,people", "--json", str(file)]
    assert against.main(options) == 0
    records = {record["what"]: record for record in json.loads(file.read_text(encoding="utf-8"))}
    assert set(records) == {
        "step of the core, p50", "step of the core, p99", "first frame, upright, p50", "first frame, lying, p50",
        "16 people in one batch, p50", "16 people, in steps of one",
    }  # fmt: skip
    step, first = records["step of the core, p50"], records["first frame, upright, p50"]
    assert 0 < step["now_us"] < first["now_us"] and 0 < step["then_us"] < first["then_us"]
    assert np.isclose(step["ratio"], step["now_us"] / step["then_us"])
    assert 1 < records["16 people, in steps of one"]["now_steps"] < 40
    assert all(record["from"] <= record["to"] for record in records.values())
    assert "synthetic motion" in capsys.readouterr().out


@in_git
def test_an_unknown_revision_is_refused_in_one_line(capsys):
    assert exit_code(lambda: against.main(["no-such-revision", "--rounds", "1"])) == 2
    said = capsys.readouterr().err
    assert "'no-such-revision' is no revision" in said and said.count("\n") == 1


@in_git
def test_a_checked_out_revision_is_deleted_afterwards():
    with checked_out(against.ROOT, "HEAD") as folder:
        assert (folder / "lassokin_ros" / "__init__.py").is_file() and Path(folder) != against.ROOT
    assert not folder.exists()


def test_the_ratio_is_the_median_of_the_rounds_and_a_slow_round_of_both_does_not_change_it():
    then, now = [[1.0] * 5, [1.0] * 5, [9.0] * 5], [[0.5] * 5, [0.5] * 5, [4.5] * 5]
    assert against._ratio_of_medians(then, now)["ratio"] == 0.5
    assert against._ratio_of_tails(then, now)["ratio"] == 0.5
