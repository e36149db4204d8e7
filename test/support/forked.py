"""Python programs as processes that are forked from one that has imported rclpy: a start takes a tenth of the time.

Tests of the start itself use `subprocess`.
"""

import multiprocessing
import os
import runpy
import subprocess
import sys
import threading
from multiprocessing import forkserver
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
CONTEXT = multiprocessing.get_context("forkserver")
CONTEXT.set_forkserver_preload(["forked", "lassokin_ros.node.node", "lassokin_ros.archive.tasks"])


class Forked:
    """As `subprocess.Popen` of [sys.executable, "-m", module, ...] or [sys.executable, file, ...], without a stdin.

    stdout: `DEVNULL` or `PIPE`. stderr: `PIPE`, or `STDOUT` for both in one. What is piped is read all the time.
    """

    def __init__(self, command, cwd=ROOT, env=None, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE):
        start_server()
        pipes = [CONTEXT.Pipe(duplex=False) if wanted == subprocess.PIPE else None for wanted in (stdout, stderr)]
        ends = [pipe and pipe[1] for pipe in pipes]
        environment = dict(os.environ if env is None else env)
        given = list(map(str, command[1:])), str(cwd), environment, *ends
        self._process = CONTEXT.Process(target=_run, args=given, daemon=True)
        self._process.start()
        self._output = [pipe and _Reader(*pipe) for pipe in pipes]
        self.pid, self.args = self._process.pid, command

    @property
    def returncode(self):
        """The exit code, -N after signal N, None while the process runs."""
        return self._process.exitcode

    def poll(self):
        """The exit code, None while the process runs."""
        return self._process.exitcode

    def wait(self, timeout=None):
        """Return the exit code. Raises subprocess.TimeoutExpired."""
        self._process.join(timeout)
        if self.returncode is None:
            raise subprocess.TimeoutExpired(self.args, timeout)
        return self.returncode

    def communicate(self, timeout=None):
        """Return (stdout, stderr), None for what is not piped. Raises subprocess.TimeoutExpired."""
        self.wait(timeout)
        return tuple(reader and reader.text() for reader in self._output)

    def send_signal(self, number):
        """Send a signal, if the process runs."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self):
        """Send SIGKILL."""
        self._process.kill()


class _Reader(threading.Thread):
    """Reads a pipe until its last writer has ended."""

    def __init__(self, reading, writing):
        super().__init__(daemon=True)
        writing.close()
        self._file, self._text = open(os.dup(reading.fileno()), encoding="utf-8", errors="replace"), []
        reading.close()
        self.start()

    def run(self):
        with self._file:
            self._text.extend(self._file)

    def text(self):
        self.join()
        return "".join(self._text)


def start_server():
    """Start the process that is forked, if there is none; it finds this module by PYTHONPATH."""
    before = os.environ.get("PYTHONPATH")
    os.environ["PYTHONPATH"] = os.pathsep.join([str(Path(__file__).parent), str(ROOT), *filter(None, [before])])
    try:
        forkserver.ensure_running()
    finally:
        del os.environ["PYTHONPATH"]
        if before is not None:
            os.environ["PYTHONPATH"] = before


def _run(arguments, folder, environment, stdout, stderr):
    """Run a program in the process that was forked for it."""
    out = stdout.fileno() if stdout else os.open(os.devnull, os.O_WRONLY)
    os.dup2(out, 1)
    os.dup2(stderr.fileno() if stderr else 1, 2)
    os.environ.clear()
    os.environ.update(environment)
    os.chdir(folder)
    paths = list(filter(None, environment.get("PYTHONPATH", "").split(os.pathsep)))
    first, *rest = arguments
    if first == "-m":
        sys.argv, sys.path[:0] = rest, [folder, *paths]
        runpy.run_module(rest[0], run_name="__main__", alter_sys=True)
    else:
        sys.argv, sys.path[:0] = arguments, [str(Path(first).parent), *paths]
        runpy.run_path(first, run_name="__main__")
