"""Process an archive on the workers of a dask.distributed cluster.

All workers and this process need this package and access to the files under the same paths. If a worker dies, the
scheduler gives its recording to another worker.
"""

from __future__ import annotations

import json
import logging
import sys
import time
from collections.abc import Generator, Sequence
from pathlib import Path
from typing import Any

from lassokin_ros.archive.tasks import ArchiveError, Result, Runner, Task, run_task
from lassokin_ros.replay import PROGRAM
from lassokin_ros.replay.bag_writer import remove_leftovers

TIMEOUT_S = 10


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
