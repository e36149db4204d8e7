"""An archive on a cluster: dask.distributed's workers do the recordings.

All of them, and this process, see the same files under the same paths, and have this package installed. A recording
whose worker dies is done again by another one; that is the scheduler's own doing.
"""

from __future__ import annotations

import json
import logging
import sys
import time
from collections.abc import Generator, Sequence
from pathlib import Path
from typing import Any

from lassokin_ros.archive.tasks import ArchiveError, Result, Runner, Task, work
from lassokin_ros.replay.bags import remove_leftovers

TIMEOUT_S = 10


def on_cluster(address: str) -> Runner:
    """A runner on a scheduler's workers. Raises ArchiveError without dask.distributed.

    address: such as tcp://10.0.0.1:8786, or the .json file that `dask scheduler --scheduler-file` writes.
    """
    try:
        import distributed
    except ImportError:
        raise ArchiveError(
            "a cluster is reached with dask.distributed; install it with: pip install 'lassokin_ros[cluster]'"
        ) from None

    # A scheduler that goes away is said in the table; its tracebacks say no more.
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)

    def run(tasks: Sequence[Task]) -> Generator[Result, None, None]:
        try:
            client = distributed.Client(_address(address), timeout=TIMEOUT_S, set_as_default=False)
        except (OSError, ValueError) as error:
            raise ArchiveError(f"there is no scheduler at '{address}': {error}") from None
        with client:
            if not client.scheduler_info()["workers"]:
                print(f"replay: the scheduler at {address} has no workers; waiting for some", file=sys.stderr)
            futures = {client.submit(work, task, pure=False): task for task in tasks}
            try:
                for future in distributed.as_completed(list(futures), loop=client.loop):
                    yield _result(future, futures[future])
            finally:
                # Of what is left nothing is begun; a worker in the middle of a recording completes it.
                client.cancel([future for future in futures if not future.done()])

    return run


def _address(given: str) -> str:
    """The scheduler's address; its file is awaited for a while, as it may have been started just now."""
    path, deadline = Path(given), time.monotonic() + TIMEOUT_S
    while path.suffix == ".json":
        try:
            return str(json.loads(path.read_text(encoding="utf-8"))["address"])
        except (OSError, ValueError, KeyError) as error:  # not there yet, or written in this moment
            if time.monotonic() > deadline:
                raise ArchiveError(f"'{given}' is no scheduler file: {error}") from None
        time.sleep(0.05)
    return given


def _result(future: Any, task: Task) -> Result:
    if future.cancelled():
        return Result(task.name, "failed: the scheduler went away, or cancelled it")
    error = future.exception()
    if error is None:
        result: Result = future.result()
        return result
    remove_leftovers(task.options.output)  # of workers that died of it
    return Result(task.name, f"failed: {type(error).__name__}: {' '.join(str(error).split())}")
