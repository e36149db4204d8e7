"""What a benchmark's user gets wrong is one line on the terminal and exit code 2."""

import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.refusals import exit_code
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
