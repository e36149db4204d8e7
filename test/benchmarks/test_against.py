"""against.py: a revision compared with itself has ratios near 1; an unusable argument is one line."""

import json
import shutil
import sys
from pathlib import Path

import pytest

from benchmarks import against
from benchmarks.common.refusals import exit_code

ROOT = Path(__file__).resolve().parents[2]
REPOSITORY = shutil.which("git") and (ROOT / ".git").exists()
pytestmark = pytest.mark.skipif(not REPOSITORY, reason="the revisions are those of a git repository")


def test_a_revision_compared_with_itself_has_ratios_near_1(tmp_path, monkeypatch):
    monkeypatch.setattr(against, "REPLAYED_S", 1.0)
    file, figures = tmp_path / "records.json", "step,replay"
    assert against.main(["HEAD", "--rounds", "1", "--figures", figures, "--json", str(file)]) == 0
    records = json.loads(file.read_text(encoding="utf-8"))
    assert [record["what"] for record in records] == figures.split(",")
    assert all(0.2 < record["ratio"] < 5 for record in records)  # a busy machine delays one of them


@pytest.mark.parametrize("arguments", [["no_such_revision"], ["HEAD", "--figures", "nothing"], []])
def test_an_unusable_argument_is_refused_in_one_line(arguments, capsys):
    with pytest.raises(SystemExit) as end:
        sys.exit(exit_code(lambda: against.main(arguments)))
    said = capsys.readouterr()
    assert end.value.code == 2 and said.out == ""
    assert arguments == [] or arguments[-1] in said.err
