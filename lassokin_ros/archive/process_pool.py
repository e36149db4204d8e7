"""Process an archive on this machine: one process per core, one recording per process at a time.

Every process is a ProcessPoolExecutor of its own. If a process dies (out of memory, a crash in a library), its
recording is known, the other processes continue, and a new process tries the recording again.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.process import BaseProcess
from threading import Thread
from types import FrameType

from lassokin_ros.archive.tasks import Result, Runner, Task, run_task
from lassokin_ros.replay.bags import remove_leftovers

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


class WorkerPool:
    """Worker processes, each with one recording at a time."""

    def __init__(self, tasks: Sequence[Task], workers: int) -> None:
        self._waiting = deque((task, 1) for task in tasks)
        self._busy: dict[Future[Result], tuple[ProcessPoolExecutor, Task, int]] = {}
        self._idle = [_worker() for _ in range(workers)]

    def results(self) -> Iterator[Result]:
        """Yield the result of each task, in order of completion."""
        while self._waiting or self._busy:
            while self._waiting and self._idle:
                worker, (task, attempt) = self._idle.pop(), self._waiting.popleft()
                try:
                    self._busy[worker.submit(_work, task)] = worker, task, attempt
                except BrokenProcessPool:  # its process died while it was idle
                    worker.shutdown(wait=False)
                    self._idle.append(_worker())
                    self._waiting.appendleft((task, attempt))
            for future in wait(self._busy, return_when=FIRST_COMPLETED).done:
                worker, task, attempt = self._busy.pop(future)
                result: Result | None
                try:
                    result = future.result()
                except (BrokenProcessPool, Terminated):
                    worker.shutdown(wait=False)
                    worker = _worker()
                    remove_leftovers(task.options.output)
                    result = Result(task.name, f"failed: its process died {ATTEMPTS} times")
                    if attempt < ATTEMPTS:
                        self._waiting.append((task, attempt + 1))
                        result = None
                except Exception as error:  # a bug, or out of memory: the other recordings continue
                    result = Result(task.name, f"failed: {type(error).__name__}: {error}")
                self._idle.append(worker)
                if result is not None:
                    yield result

    def stop(self) -> None:
        """Stop all processes. Busy ones remove their unfinished output first."""
        if self._busy:
            for process in multiprocessing.active_children():
                process.terminate()
        for worker in [*self._idle, *(worker for worker, _, _ in self._busy.values())]:
            worker.shutdown(wait=True, cancel_futures=True)
        for _, task, _ in self._busy.values():
            remove_leftovers(task.options.output)


def _worker() -> ProcessPoolExecutor:
    """Return a pool of one spawned process, which inherits no threads and no library state."""
    return ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), _begin)


def _begin() -> None:
    """Initialise a worker process: ignore Ctrl-C, which the parent handles, and exit if the parent dies."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        Thread(target=_exit_with, args=(parent,), daemon=True).start()


def _exit_with(process: BaseProcess) -> None:
    process.join()
    os._exit(1)


def _work(task: Task) -> Result:
    """Run a task. SIGTERM stops it, and its unfinished output is removed."""
    signal.signal(signal.SIGTERM, _stop)
    try:
        return run_task(task)
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _stop(_number: int, _frame: FrameType | None) -> None:
    raise Terminated
