"""An archive on this machine: one process per core, each with a recording at a time.

Every process is a pool of its own. When one dies (out of memory, a crash in a library), it is then known which
recording it held, the others go on, and that one is done again by a new process.
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

from lassokin_ros.archive.tasks import Result, Runner, Task, work
from lassokin_ros.replay.bags import remove_leftovers

ATTEMPTS = 3
"""Processes that may die of a recording before it is given up."""


class Dismissed(BaseException):
    """SIGTERM in a process that holds a recording."""


def cores() -> int:
    """Cores that this process may use."""
    usable = getattr(os, "sched_getaffinity", None)
    return len(usable(0)) if usable else os.cpu_count() or 1


def in_processes(jobs: int | None) -> Runner:
    """A runner with so many processes, by default one for each core."""

    def run(tasks: Sequence[Task]) -> Generator[Result, None, None]:
        # One thread in each: the matrices are small, and the cores have a recording each.
        os.environ["OMP_NUM_THREADS"] = "1"
        crew = Crew(tasks, min(jobs or cores(), len(tasks)))
        try:
            yield from crew.results()
        finally:
            crew.dismiss()

    return run


class Crew:
    """Workers with a recording each."""

    def __init__(self, tasks: Sequence[Task], workers: int) -> None:
        self._waiting = deque((task, 1) for task in tasks)
        self._busy: dict[Future[Result], tuple[ProcessPoolExecutor, Task, int]] = {}
        self._idle = [_worker() for _ in range(workers)]

    def results(self) -> Iterator[Result]:
        """Each task's result, in the order in which they end."""
        while self._waiting or self._busy:
            while self._waiting and self._idle:
                worker, (task, attempt) = self._idle.pop(), self._waiting.popleft()
                self._busy[worker.submit(_work, task)] = worker, task, attempt
            for future in wait(self._busy, return_when=FIRST_COMPLETED).done:
                worker, task, attempt = self._busy.pop(future)
                result: Result | None
                try:
                    result = future.result()
                except (BrokenProcessPool, Dismissed):
                    worker.shutdown(wait=False)
                    worker = _worker()
                    remove_leftovers(task.options.output)
                    result = Result(task.name, f"failed: its process died {ATTEMPTS} times")
                    if attempt < ATTEMPTS:
                        self._waiting.append((task, attempt + 1))
                        result = None
                except Exception as error:  # a bug of ours, or no memory: not the end of the others
                    result = Result(task.name, f"failed: {type(error).__name__}: {error}")
                self._idle.append(worker)
                if result is not None:
                    yield result

    def dismiss(self) -> None:
        """End all processes; those that hold a recording clean up behind them first."""
        if self._busy:
            for process in multiprocessing.active_children():
                process.terminate()
        for worker in [*self._idle, *(worker for worker, _, _ in self._busy.values())]:
            worker.shutdown(wait=True, cancel_futures=True)
        for _, task, _ in self._busy.values():
            remove_leftovers(task.options.output)


def _worker() -> ProcessPoolExecutor:
    """A process of its own, started anew (spawn): nothing of this one's threads and libraries is in it."""
    return ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), _begin)


def _begin() -> None:
    """In the new process: Ctrl-C reaches all processes of a terminal; the first one tells the others what to do.

    Without the first one, killed perhaps, nobody would: then this one ends too.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    first = multiprocessing.parent_process()
    if first is not None:
        Thread(target=_end_with, args=(first,), daemon=True).start()


def _end_with(process: BaseProcess) -> None:
    process.join()
    os._exit(1)


def _work(task: Task) -> Result:
    """Do a task; SIGTERM ends it, and its unfinished output is removed."""
    signal.signal(signal.SIGTERM, _stop)
    try:
        return work(task)
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _stop(_number: int, _frame: FrameType | None) -> None:
    raise Dismissed
