"""against.py: a revision compared with itself has ratios near 1; an unusable argument is one line."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks import against

ROOT = Path(__file__).resolve().parents[2]
REPOSITORY = shutil.which("git") and (ROOT / ".git").exists()
pytestmark = pytest.mark.skipif(not REPOSITORY, reason="the revisions are those of a git repository")


def run(*arguments):
    command = [sys.executable, "benchmarks/against.py", *arguments]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120, check=False)


def test_a_revision_compared_with_itself_has_ratios_near_1(tmp_path, monkeypatch):
    monkeypatch.setattr(against, "REPLAYED_S", 1.0)
    file, figures = tmp_path / "records.json", "step,first_upright,replay"
    assert against.main(["HEAD", "--rounds", "1", "--figures", figures, "--json", str(file)]) == 0
    records = json.loads(file.read_text(encoding="utf-8"))
    assert [record["what"] for record in records] == figures.split(",")
    assert all(0.2 < record["ratio"] < 5 for record in records)  # a busy machine delays one of them


@pytest.mark.parametrize("arguments", [["no_such_revision"], ["HEAD", "--figures", "nothing"], []])
def test_an_unusable_argument_is_refused_in_one_line(arguments):
    done = run(*arguments)
    assert done.returncode == 2 and done.stdout == ""
    assert arguments == [] or arguments[-1] in done.stderr
