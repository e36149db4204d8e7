"""Test one mutant: write it into a copy of the repository, run the tests of its module, restore the original."""

from __future__ import annotations

import contextlib
import difflib
import multiprocessing
import os
import resource
import shutil
import signal
import sys
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lassokin_ros.core.kernel import SWITCH

LEFT_OUT = shutil.ignore_patterns(".git", ".venv", "build", "install", "log", "demo_output", "*.egg-info", "*_cache")
PRELOADED = ("pytest", "hypothesis", "numpy", "scipy.optimize", "scipy.sparse", "scipy.spatial.transform", "yaml",
             "proxsuite", "qpsolvers", "rosbags.typesys", "rosbags.rosbag2")  # fmt: skip
"""Modules that tests import and mutants do not change. They are loaded once; every trial is forked from there."""
PATIENCE = 3.0
"""Time limit of a trial: this multiple of the time of the unmutated tests, plus GRACE_S."""
GRACE_S = 20.0


@dataclass(frozen=True)
class Trial:
    """How the tests of a module ended: pytest's exit code (negative: a signal), None after a time-out. Times in s.

    seconds: of each test file, as far as it was run.
    """

    code: int | None
    cpu_s: float
    wall_s: float
    seconds: Mapping[str, float]


class Copy:
    """A copy of the repository in `folder`, whose files are changed."""

    def __init__(self, repository: Path, folder: Path, preloaded: Sequence[str] = PRELOADED) -> None:
        self.repository, self.root = repository, folder / "copy"
        shutil.copytree(repository, self.root, ignore=LEFT_OUT, symlinks=True)
        os.environ["PYTHONPATH"] = str(self.root)
        os.environ[SWITCH] = "0"  # the mutants are in the Python code
        self._context = multiprocessing.get_context("forkserver")
        self._context.set_forkserver_preload(list(preloaded))
        self._changes = 0

    @contextlib.contextmanager
    def changed(self, path: Path, code: str) -> Iterator[None]:
        """Write `code` to the repository's `path` in the copy, each time with a later date, because Python caches by
        date.
        """
        target = self.root / path.relative_to(self.repository)
        original, dates = target.read_text(encoding="utf-8"), target.stat()
        self._changes += 1
        try:
            target.write_text(code, encoding="utf-8")
            os.utime(target, (dates.st_atime, dates.st_mtime + self._changes))
            yield
        finally:
            target.write_text(original, encoding="utf-8")
            os.utime(target, (dates.st_atime, dates.st_mtime))

    def test(self, tests: Sequence[str], usual: Trial | None = None) -> Trial:
        """Run tests of the copy, with a time limit from `usual`; no limit without it."""
        limit = None if usual is None else GRACE_S + PATIENCE * usual.cpu_s
        receiver, sender = self._context.Pipe(duplex=False)
        process = self._context.Process(target=_run, args=(str(self.root), list(tests), limit, sender))
        start = time.monotonic()
        process.start()
        process.join(None if usual is None else GRACE_S + 3 * PATIENCE * max(usual.wall_s, usual.cpu_s))
        timed_out = process.exitcode in (None, -signal.SIGXCPU)
        assert process.pid is not None
        process.kill()
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)  # processes started by the tests
        process.join()
        cpu, seconds = receiver.recv() if receiver.poll() else (0.0, {})
        return Trial(None if timed_out else process.exitcode, cpu, time.monotonic() - start, seconds)


class FileTimes:
    """A plugin of pytest that measures the time of each test file."""

    def __init__(self) -> None:
        self.seconds: Counter[str] = Counter()

    def pytest_runtest_logreport(self, report: Any) -> None:
        """Add the time of a test's set-up, call or tear-down."""
        self.seconds[report.nodeid.partition("::")[0]] += report.duration


def _run(root: str, tests: list[str], limit: float | None, sender: multiprocessing.connection.Connection) -> None:
    """In the process of a trial: run pytest on the copy, without output."""
    import pytest

    os.setsid()
    if limit is not None:
        resource.setrlimit(resource.RLIMIT_CPU, (int(limit) + 1, int(limit) + 3))
    sys.dont_write_bytecode = False  # compiled files are shared by all trials
    os.chdir(root)
    sys.path[:] = [root, *(entry for entry in sys.path if entry != "")]
    for name in [name for name in sys.modules if name.partition(".")[0] in os.listdir(root)]:
        del sys.modules[name]  # from the repository, as imported by this module; the mutant is in the copy
    silence = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silence, 1)
    os.dup2(silence, 2)
    times = FileTimes()
    options = ["-x", "-q", "--rootdir", root, "-p", "no:cacheprovider", "-p", "no:xdist"]
    code = pytest.main([*options, *tests], plugins=[times])
    sender.send((time.process_time(), dict(times.seconds)))
    os._exit(int(code))


def tests_of(path: Path, repository: Path) -> list[str]:
    """The tests of a module: the files of the folder that mirrors its folder, or of the nearest existing one above.

    lassokin_ros/core/body/rotations.py is tested by test/core/body/test_*.py.
    """
    parts = path.relative_to(repository).parent.parts
    folder = repository.joinpath("test", *parts[1:] if parts[0] == "lassokin_ros" else parts)
    while not folder.is_dir():
        folder = folder.parent
    return [str(file.relative_to(repository)) for file in sorted(folder.glob("test_*.py"))]


def difference(original: str, mutated: str) -> str:
    """The different lines, in the format of diff, without context."""
    lines = difflib.unified_diff(original.split("\n"), mutated.split("\n"), lineterm="", n=0)
    return "\n".join(line for line in lines if not line.startswith(("---", "+++", "@@")))
