"""The processes of an archive: one that dies while it waits for a recording is replaced."""

import argparse
import os
import signal
from concurrent.futures.process import BrokenProcessPool

import pytest

from lassokin_ros.archive.process_pool import WorkerPool
from lassokin_ros.archive.tasks import Task


def test_a_process_that_dies_while_idle_is_replaced(tmp_path):
    tasks = [Task(str(i), argparse.Namespace(output=tmp_path / str(i))) for i in range(2)]
    pool = WorkerPool(tasks, 1)  # without options, each task fails at once
    try:
        results = pool.results()
        first = next(results)
        (worker,) = pool._idle
        (process,) = worker._processes.values()
        os.kill(process.pid, signal.SIGKILL)
        process.join()
        with pytest.raises(BrokenProcessPool):
            while True:
                worker.submit(int).result()
        (second,) = results
    finally:
        pool.stop()
    assert [first.name, second.name] == ["0", "1"] and "died" not in second.outcome
