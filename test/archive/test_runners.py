"""The processes of an archive: one that dies while it waits for a recording is replaced."""

import argparse
import os
import signal

import pytest

from lassokin_ros.archive.runners import WorkerPool
from lassokin_ros.archive.tasks import Task


@pytest.mark.usefixtures("forked_workers")
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
