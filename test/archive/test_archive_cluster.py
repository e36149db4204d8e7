"""`replay --scheduler` with a real scheduler and two real workers on this machine, one of which is killed."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

pytest.importorskip("rosbags", reason="rosbags reads and writes recordings")
pytest.importorskip("distributed", reason="dask.distributed is not installed (pip install '.[cluster]')")

from archives import ROOT, holder, outcomes, write_archive  # noqa: E402
from forked import Forked  # noqa: E402
from recordings import contents  # noqa: E402

from lassokin_ros.cli.replay import main  # noqa: E402

pytestmark = pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="finds processes in /proc, which is Linux'")
HERE = "127.0.0.1"


@contextmanager
def process(*command):
    """A process of dask for the duration of the test; it and its child processes end with the context."""
    running = Forked([sys.executable, "-m", "dask", *command], ROOT)
    try:
        yield running
    finally:
        running.kill()
        running.wait()


@contextmanager
def cluster(folder):
    """(address of a scheduler at a free port, ids of two workers with one thread each, the scheduler's process)."""
    with ExitStack() as stack:
        facts = folder / "scheduler.json"
        scheduler = stack.enter_context(
            process("scheduler", "--host", HERE, "--port", 0, "--no-dashboard", "--scheduler-file", facts)
        )
        options = ("--scheduler-file", facts, "--host", HERE, "--nthreads", 1, "--no-nanny", "--no-dashboard")
        options += ("--local-directory", folder / "scratch", "--death-timeout", 120)
        workers = [stack.enter_context(process("worker", *options)) for _ in range(2)]
        deadline = time.monotonic() + 120
        while not (facts.exists() and facts.stat().st_size):
            assert time.monotonic() < deadline and scheduler.poll() is None
            time.sleep(0.05)
        yield json.loads(facts.read_text())["address"], [worker.pid for worker in workers], scheduler


def start_replay(*arguments):
    """The command as a forked process."""
    return Forked([sys.executable, "-m", "lassokin_ros.cli.replay", *arguments], ROOT, stdout=subprocess.PIPE)


def lose_the_scheduler(archive, output, address, scheduler):
    """The scheduler dies with its state. The table lists the unfinished recordings instead of tracebacks."""
    running = start_replay(archive / "z_long0", archive / "squat.v2", "--output", output, "--scheduler", address)
    holder(running, output / "z_long0_tracked")
    scheduler.kill()
    said, complained = running.communicate(timeout=120)
    assert running.returncode == 2 and complained == ""
    assert outcomes(said)["z_long0"] == "failed: the scheduler was lost, or cancelled the task"


def test_an_archive_is_completed_if_one_of_two_workers_is_killed(tmp_path, capsys):
    archive, output = write_archive(tmp_path / "in", long=1), tmp_path / "out"
    with cluster(tmp_path) as (address, workers, scheduler):
        assert address.startswith(f"tcp://{HERE}:")
        arguments = (archive, "--output", output, "--scheduler", address)
        running = start_replay(*arguments)
        victim = holder(running, output / "z_long0_tracked")
        assert victim in workers
        os.kill(victim, signal.SIGKILL)
        (other,) = set(workers) - {victim}
        assert holder(running, output / "z_long0_tracked", but=(victim,)) == other
        said, complained = running.communicate(timeout=120)
        results = outcomes(said)
        assert running.returncode == 2, complained
        assert results.pop("torn").startswith("failed: ") and results["z_long0"] == "tracked"
        # A recording that the killed worker finished, but could not report, is found done by the other.
        assert set(results.values()) <= {"tracked", "done before"}
        assert len(results) == 4 and list(output.rglob(".*")) == []
        assert main([*map(str, arguments)]) == 2
        again = outcomes(capsys.readouterr().out)
        assert again.pop("torn").startswith("failed: ") and set(again.values()) == {"done before"}
        lose_the_scheduler(archive, tmp_path / "gone", address, scheduler)
    for name in ("z_long0", "squat.v2"):
        assert main([str(archive / name), "--output", str(tmp_path / name)]) == 0
        assert contents(output / f"{name}_tracked") == contents(tmp_path / name)


@pytest.mark.parametrize(
    "address, expected",
    [
        (f"tcp://{HERE}:9", f"no scheduler at 'tcp://{HERE}:9'"),
        ("nowhere", "no scheduler at 'nowhere'"),
        ("nix.json", "'nix.json' is not a scheduler file: [Errno 2] No such file or directory: 'nix.json'"),
    ],
)
def test_a_missing_scheduler_is_one_line(tmp_path, capsys, monkeypatch, address, expected):
    import lassokin_ros.archive.runners as archive_dask

    monkeypatch.setattr(archive_dask, "TIMEOUT_S", 0.3)
    archive = write_archive(tmp_path / "in")
    assert main([str(archive), "--output", str(tmp_path / "out"), "--scheduler", address]) == 2
    said = capsys.readouterr()
    assert said.out == "" and said.err.startswith(f"lassokin replay: {expected}")
    assert said.err.count("\n") == 1
