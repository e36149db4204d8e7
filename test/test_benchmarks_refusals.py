"""What a benchmark's user gets wrong is one line on the terminal and exit code 2."""

import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks import accuracy, latency, soak, solvers
from benchmarks.refusals import exit_code
from benchmarks.report import write_json
from lassokin_ros.core.errors import LassokinError

ROOT = Path(__file__).resolve().parents[1]


@pytest.mark.parametrize("error", [SystemExit("no such clip"), LassokinError("no such clip")])
def test_what_is_refused_is_one_line(error, capsys):
    def command():
        raise error

    assert exit_code(command) == 2
    said = capsys.readouterr()
    assert said.err.endswith(": no such clip\n") and said.err.count("\n") == 1 and not said.out


def test_what_ends_well_or_says_its_own_code_is_left_alone():
    assert exit_code(lambda: None) == 0 and exit_code(lambda: 1) == 1
    with pytest.raises(SystemExit) as end:
        exit_code(lambda: sys.exit(3))
    assert end.value.code == 3


@pytest.mark.parametrize(
    "script, options, said",
    [
        ("accuracy", ["--data", "nowhere"], "no clips"),
        ("accuracy", ["--methods", "magic"], "no method magic"),
        ("accuracy", ["--detections", "nowhere.npz"], "no file nowhere.npz"),
        ("solvers", ["--data", "nowhere"], "nowhere lacks some of"),
    ],
)
def test_scripts_say_what_they_refuse(script, options, said):
    command = [sys.executable, f"benchmarks/{script}.py", *options]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert result.returncode == 2
    assert result.stderr.startswith(f"{script}.py: {said}") and result.stderr.count("\n") == 1


@pytest.mark.parametrize("command", [accuracy.main, latency.main, solvers.main, soak.main])
@pytest.mark.parametrize("place", ["nowhere/records.json", "."])
def test_records_that_could_not_be_written_are_said_before_the_work(command, place, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as end:
        command(["--json", place])
    assert end.value.code == 2
    assert f"argument --json: {place}; expected a file in a folder that exists" in capsys.readouterr().err


def test_a_disk_that_is_full_when_the_records_are_written_is_said():
    with pytest.raises(SystemExit, match="cannot write /dev/full: No space left"):
        write_json(Path("/dev/full"), [{"clip": "x"}])
