"""Run the tasks of an archive: on this machine, one process per core, or on the workers of a dask.distributed cluster.

Each process has a pipe of its own to this one. If a process dies (out of memory, a crash in a library), the end of its
pipe tells which one; the other processes continue, and a new process tries its recording again. ProcessPoolExecutor
would do, but until Python 3.12 a future that is submitted while its process dies may never complete.

All workers of a cluster and this process need this package and access to the files under the same paths. If a worker
dies, the scheduler gives its recording to another worker.
"""

from __future__ import annotations

import json
import logging
import multiprocessing
import os
import signal
import sys
import time
from collections import deque
from collections.abc import Generator, Iterator, Sequence
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from threading import Thread
from types import FrameType
from typing import Any

from lassokin_ros.archive.tasks import ArchiveError, Result, Runner, Task, run_task
from lassokin_ros.replay import PROGRAM
from lassokin_ros.replay.bag_writer import remove_leftovers

ATTEMPTS = 3
"""Number of processes that try a recording before it counts as failed."""


class Terminated(BaseException):
    """SIGTERM in a worker process that is processing a recording."""


def cores() -> int:
    """Return the number of cores that this process may use."""
    usable = getattr(os, "sched_getaffinity", None)
    return len(usable(0)) if usable else os.cpu_count() or 1


def in_processes(jobs: int | None) -> Runner:
    """Return a runner with `jobs` processes, by default one per core."""

    def run(tasks: Sequence[Task]) -> Generator[Result, None, None]:
        # One BLAS thread per process: the matrices are small, and each core processes a recording.
        os.environ["OMP_NUM_THREADS"] = "1"
        pool = WorkerPool(tasks, min(jobs or cores(), len(tasks)))
        try:
            yield from pool.results()
        finally:
            pool.stop()

    return run


class Worker:
    """A spawned process, which inherits no threads and no library state, and this process's end of its pipe."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, its_end = context.Pipe()
        self.process = context.Process(target=_serve, args=(its_end,), daemon=True)  # ends with this process
        self.process.start()
        its_end.close()  # the pipe ends with the process

    def start(self, task: Task) -> bool:
        """Let the process run a task. Return False if it has died."""
        try:
            self.pipe.send(task)
        except OSError:
            return False
        return True

    def result(self) -> Result | None:
        """Wait for the result of the task, and return it. Return None if the process has died."""
        try:
            return self.pipe.recv()
        except (EOFError, OSError):
            return None

    def end(self) -> None:
        """Wait until the process has ended, which it does if it is idle, dead or terminated."""
        self.pipe.close()
        self.process.join()


class WorkerPool:
    """Worker processes, each with one recording at a time."""

    def __init__(self, tasks: Sequence[Task], workers: int) -> None:
        self._waiting = deque((task, 1) for task in tasks)
        self._busy: dict[Worker, tuple[Task, int]] = {}
        self._idle = [Worker() for _ in range(workers)]

    def results(self) -> Iterator[Result]:
        """Yield the result of each task, in order of completion."""
        while self._waiting or self._busy:
            while self._waiting and self._idle:
                worker, (task, attempt) = self._idle.pop(), self._waiting.popleft()
                while not worker.start(task):  # it died while it was idle
                    worker.end()
                    worker = Worker()
                self._busy[worker] = task, attempt
            ready = wait([worker.pipe for worker in self._busy])
            for worker in [worker for worker in self._busy if worker.pipe in ready]:
                task, attempt = self._busy.pop(worker)
                result = worker.result()
                if result is None:
                    worker.end()
                    worker = Worker()
                    remove_leftovers(task.options.output)
                    if attempt < ATTEMPTS:
                        self._waiting.append((task, attempt + 1))
                    else:
                        result = Result(task.name, f"failed: its process died {ATTEMPTS} times")
                self._idle.append(worker)
                if result is not None:
                    yield result

    def stop(self) -> None:
        """Stop all processes. Busy ones remove their unfinished output first."""
        for worker in self._busy:
            worker.process.terminate()
        for worker in [*self._idle, *self._busy]:
            worker.end()
        for task, _ in self._busy.values():
            remove_leftovers(task.options.output)


def _serve(pipe: Connection) -> None:
    """Run tasks until the pipe ends. Ctrl-C is the parent's to handle; the process ends if the parent dies."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        Thread(target=_exit_with, args=(parent,), daemon=True).start()
    try:
        while True:
            pipe.send(_work(pipe.recv()))
    except (EOFError, Terminated):
        return


def _exit_with(process: BaseProcess) -> None:
    process.join()
    os._exit(1)


def _work(task: Task) -> Result:
    """Run a task. SIGTERM stops it, and its unfinished output is removed."""
    signal.signal(signal.SIGTERM, _stop)
    try:
        return run_task(task)
    except Exception as error:  # a bug, or out of memory: the other recordings continue
        return Result(task.name, f"failed: {type(error).__name__}: {error}")
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _stop(_number: int, _frame: FrameType | None) -> None:
    raise Terminated


TIMEOUT_S = 10
"""s to wait for a scheduler, or for its file."""


def on_cluster(address: str) -> Runner:
    """Return a runner that uses the workers of a scheduler. Raises ArchiveError if dask.distributed is missing.

    address: such as tcp://10.0.0.1:8786, or the .json file that `dask scheduler --scheduler-file` writes.
    """
    try:
        import distributed
    except ImportError:
        raise ArchiveError("--scheduler needs dask.distributed; install it with: pip install '.[cluster]'") from None

    # The table reports a lost scheduler; the tracebacks of dask add nothing.
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)

    def run(tasks: Sequence[Task]) -> Generator[Result, None, None]:
        try:
            client = distributed.Client(_address(address), timeout=TIMEOUT_S, set_as_default=False)
        except (OSError, ValueError) as error:
            raise ArchiveError(f"no scheduler at '{address}': {error}") from None
        with client:
            if not client.scheduler_info()["workers"]:
                print(f"{PROGRAM}: the scheduler at {address} has no workers; waiting for a worker", file=sys.stderr)
            futures = {client.submit(run_task, task, pure=False): task for task in tasks}
            try:
                for future in distributed.as_completed(list(futures), loop=client.loop):
                    yield _result(future, futures[future])
            finally:
                # Recordings that have not started are cancelled; running ones are completed by their workers.
                client.cancel([future for future in futures if not future.done()])

    return run


def _address(given: str) -> str:
    """Return the scheduler's address. Wait up to TIMEOUT_S for a scheduler file."""
    path, deadline = Path(given), time.monotonic() + TIMEOUT_S
    while path.suffix == ".json":
        try:
            return str(json.loads(path.read_text(encoding="utf-8"))["address"])
        except (OSError, ValueError, KeyError) as error:  # not written yet, or incomplete
            if time.monotonic() > deadline:
                raise ArchiveError(f"'{given}' is not a scheduler file: {error}") from None
        time.sleep(0.05)
    return given


def _result(future: Any, task: Task) -> Result:
    if future.cancelled():
        return Result(task.name, "failed: the scheduler was lost, or cancelled the task")
    error = future.exception()
    if error is None:
        result: Result = future.result()
        return result
    remove_leftovers(task.options.output)  # of dead workers
    return Result(task.name, f"failed: {type(error).__name__}: {' '.join(str(error).split())}")
