"""same_output.py: topics are compared by bytes and times, and a revision has the same output as itself."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks import same_output
from benchmarks.common.refusals import exit_code
from benchmarks.same_output import compare

ROOT = Path(__file__).resolve().parents[2]
REPOSITORY = shutil.which("git") and (ROOT / ".git").exists()
needs_repository = pytest.mark.skipif(not REPOSITORY, reason="the revisions are those of a git repository")


def run(*arguments):
    command = [sys.executable, "benchmarks/same_output.py", *arguments]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120, check=False)


def results(this, other):
    return {record["topic"]: record["result"] for record in compare(this, other)}


def test_compare_finds_the_first_different_message():
    messages = [(0, b"a"), (1, b"b"), (2, b"c")]
    assert results({"t": messages}, {"t": list(messages)}) == {"t": "equal"}
    assert results({"t": messages}, {"t": [(0, b"a"), (1, b"B"), (2, b"c")]}) == {"t": "different from message 1 on"}
    assert results({"t": messages}, {"t": [(0, b"a"), (1, b"b"), (3, b"c")]}) == {"t": "different from message 2 on"}


def test_compare_reports_missing_messages_and_topics():
    messages = [(0, b"a"), (1, b"b")]
    assert results({"t": messages}, {"t": messages[:1]}) == {"t": "different from message 1 on"}
    assert results({"t": messages}, {"u": []}) == {"t": "different from message 0 on", "u": "equal"}


@needs_repository
def test_a_revision_has_the_same_output_as_itself():
    done = run("HEAD", "--people", "1", "--seconds", "0.2")
    assert "/tracker/joint_states" in done.stdout and "topics are equal" in done.stdout, done.stderr
    changed = ["git", "status", "--porcelain", "--", "lassokin_ros", "msg_adapters"]
    if not subprocess.run(changed, cwd=ROOT, capture_output=True, check=True).stdout:
        assert done.returncode == 0, done.stdout


@needs_repository
@pytest.mark.parametrize("arguments", [["no_such_revision"], ["HEAD", "--people", "ten"], []])
def test_an_unusable_argument_is_refused_in_one_line(arguments, capsys):
    with pytest.raises(SystemExit) as end:
        sys.exit(exit_code(lambda: same_output.main(arguments)))
    said = capsys.readouterr()
    assert end.value.code == 2 and said.out == ""
    assert arguments == [] or arguments[-1] in said.err
