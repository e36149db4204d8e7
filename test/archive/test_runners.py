"""The processes of an archive: they may die, be killed or be interrupted."""

import argparse
import os
import signal
from pathlib import Path

import pytest

pytest.importorskip("rosbags", reason="rosbags reads and writes recordings")

from archives import holder, killed_writers, outcomes, replayed, start_replay, write_archive  # noqa: E402
from forked import CONTEXT, start_server  # noqa: E402
from recordings import contents  # noqa: E402

from lassokin_ros.archive import runners  # noqa: E402
from lassokin_ros.archive.runners import WorkerPool  # noqa: E402
from lassokin_ros.archive.tasks import Task  # noqa: E402
from lassokin_ros.cli.replay import main  # noqa: E402

needs_proc = pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="finds processes in /proc, which is Linux'")


@pytest.fixture(autouse=True)
def forked_workers(monkeypatch):
    """The workers are forked, which takes a tenth of the time; those of `start_replay` are spawned."""
    start_server()
    monkeypatch.setattr(runners.multiprocessing, "get_context", lambda _: CONTEXT)


@pytest.mark.parametrize("dead", [True, False], ids=["dead", "dying"])
def test_a_process_that_dies_while_idle_is_replaced(tmp_path, dead):
    tasks = [Task(str(i), argparse.Namespace(output=tmp_path / str(i))) for i in range(2)]
    pool = WorkerPool(tasks, 1)  # without options, each task fails at once
    try:
        results = pool.results()
        first = next(results)
        (worker,) = pool._idle
        os.kill(worker.process.pid, signal.SIGKILL)
        if dead:
            worker.process.join()
        (second,) = results
        assert pool._idle != [worker]
    finally:
        pool.stop()
    assert [first.name, second.name] == ["0", "1"] and "died" not in second.outcome
    assert "AttributeError" in first.outcome and "AttributeError" in second.outcome
    assert not worker.process.is_alive() and worker.pipe.closed


def hidden(folder):
    return [entry.name for entry in folder.rglob(".*")]


@pytest.fixture(scope="module")
def long_archive(tmp_path_factory):
    return write_archive(tmp_path_factory.mktemp("long") / "bags", long=1)


@needs_proc
def test_a_recording_whose_process_is_killed_is_repeated(long_archive, tmp_path, capsys):
    output = tmp_path / "out"
    with killed_writers(output / "z_long0_tracked", 1) as killed:
        code, said = replayed(capsys, long_archive, "--output", output, "--jobs", 2)
    assert code == 2 and len(killed) == 1
    results = outcomes(said)
    assert results.pop("torn").startswith("failed: ") and set(results.values()) == {"tracked"}
    assert hidden(output) == []
    assert main([str(long_archive / "z_long0"), "--output", str(tmp_path / "alone")]) == 0
    assert contents(output / "z_long0_tracked") == contents(tmp_path / "alone")


@needs_proc
def test_a_recording_that_kills_every_process_is_skipped(long_archive, tmp_path, capsys):
    output = tmp_path / "out"
    recordings = (long_archive / "z_long0", long_archive / "day1" / "wave")
    with killed_writers(output / "z_long0_tracked", 3):
        code, said = replayed(capsys, *recordings, "--output", output, "--jobs", 1)
    assert code == 2 and outcomes(said) == {"z_long0": "failed: its process died 3 times", "wave": "tracked"}
    assert os.listdir(output) == ["wave_tracked"]


@needs_proc
def test_processes_end_when_the_command_is_killed(long_archive, tmp_path):
    running = start_replay(long_archive / "z_long0", long_archive / "squat.v2", "--output", tmp_path, "--jobs", 1)
    worker = holder(running, tmp_path / "z_long0_tracked")
    running.kill()
    running.communicate(timeout=120)  # reads until the last process with the other end of the pipes has ended
    assert not Path(f"/proc/{worker}/fd").is_dir() or not list(Path(f"/proc/{worker}/fd").iterdir())


@needs_proc
def test_an_interrupted_archive_leaves_complete_outputs_and_can_continue(long_archive, tmp_path, capsys):
    """By SIGINT for all its processes, as from Ctrl-C in a terminal."""
    running = start_replay(long_archive / "day1", long_archive / "z_long0", "--output", tmp_path, "--jobs", 1)
    holder(running, tmp_path / "z_long0_tracked")
    os.killpg(running.pid, signal.SIGINT)
    said, complained = running.communicate(timeout=120)
    assert running.returncode == 130 and said == ""
    done = "2 of 3 recordings are done; run the same command again to continue"
    assert complained == f"lassokin replay: interrupted; {done}\n"
    assert sorted(os.listdir(tmp_path)) == ["walk_tracked", "wave_tracked"]
    code, said = replayed(capsys, long_archive / "day1", "--output", tmp_path)
    assert code == 0 and outcomes(said) == {"walk": "done before", "wave": "done before"}
