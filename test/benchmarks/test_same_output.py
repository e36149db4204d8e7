"""same_output.py compares topics by bytes and times, and a revision has its own output; against.py refuses alike."""

import shutil
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from benchmarks import against, same_output
from benchmarks.common import revision
from benchmarks.common.report import exit_code
from benchmarks.same_output import compare

ROOT = Path(__file__).resolve().parents[2]
REPOSITORY = shutil.which("git") and (ROOT / ".git").exists()
needs_repository = pytest.mark.skipif(not REPOSITORY, reason="the revisions are those of a git repository")


@pytest.mark.parametrize(
    "other, result",
    [
        ([(0, b"a"), (1, b"b"), (2, b"c")], "equal"),
        ([(0, b"a"), (1, b"B"), (2, b"c")], "different from message 1 on"),
        ([(0, b"a"), (1, b"b"), (3, b"c")], "different from message 2 on"),
        ([(0, b"a")], "different from message 1 on"),
        (None, "different from message 0 on"),
    ],
)
def test_compare_finds_the_first_different_or_missing_message(other, result):
    others = {"u": []} if other is None else {"t": other, "u": []}
    records = compare({"t": [(0, b"a"), (1, b"b"), (2, b"c")]}, others)
    assert {record["topic"]: record["result"] for record in records} == {"t": result, "u": "equal"}


def test_a_revision_has_the_same_output_as_itself(monkeypatch, capsys):
    """Of this tree, which is not copied."""
    monkeypatch.setattr(same_output, "check_out", lambda name, folder: folder.symlink_to(ROOT) or name)
    assert same_output.main(["HEAD", "--people", "1", "--seconds", "0.2"]) == 0
    said = capsys.readouterr().out
    assert "/tracker/joint_states" in said and "this tree against HEAD" in said


@needs_repository
def test_a_revision_is_unpacked(tmp_path, monkeypatch):
    monkeypatch.setattr(revision, "kernel", SimpleNamespace(active=False))  # it takes long to compile
    name = revision.check_out("HEAD", tmp_path / "revision")
    assert len(name) >= 7 and (tmp_path / "revision" / "lassokin_ros" / "core" / "_kernel.c").is_file()


@needs_repository
@pytest.mark.parametrize(
    ("command", "arguments"),
    [
        (same_output.main, ["no_such_revision"]),
        (same_output.main, ["HEAD", "--people", "ten"]),
        (same_output.main, []),
        (against.main, ["no_such_revision"]),
        (against.main, ["HEAD", "--figures", "nothing"]),
    ],
)
def test_an_unusable_argument_is_refused_in_one_line(command, arguments, capsys):
    with pytest.raises(SystemExit) as end:
        sys.exit(exit_code(lambda: command(arguments)))
    said = capsys.readouterr()
    assert end.value.code == 2 and said.out == ""
    assert arguments == [] or arguments[-1] in said.err
