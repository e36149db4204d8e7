"""against.py: an unusable argument is one line."""

import shutil
import sys
from pathlib import Path

import pytest

from benchmarks import against
from benchmarks.common.report import exit_code

ROOT = Path(__file__).resolve().parents[2]
REPOSITORY = shutil.which("git") and (ROOT / ".git").exists()
pytestmark = pytest.mark.skipif(not REPOSITORY, reason="the revisions are those of a git repository")


@pytest.mark.parametrize("arguments", [["no_such_revision"], ["HEAD", "--figures", "nothing"], []])
def test_an_unusable_argument_is_refused_in_one_line(arguments, capsys):
    with pytest.raises(SystemExit) as end:
        sys.exit(exit_code(lambda: against.main(arguments)))
    said = capsys.readouterr()
    assert end.value.code == 2 and said.out == ""
    assert arguments == [] or arguments[-1] in said.err
