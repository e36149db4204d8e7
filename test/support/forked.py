"""Python programs as processes that are forked from one that has imported rclpy: a start takes a tenth of the time.

Tests of the start itself use `subprocess`.
"""

import multiprocessing
import os
import runpy
import signal
import socket
import subprocess
import sys
import threading
from multiprocessing import forkserver
from pathlib import Path
from types import SimpleNamespace

ROOT = Path(__file__).resolve().parents[2]
CONTEXT = multiprocessing.get_context("forkserver")
CONTEXT.set_forkserver_preload(["forked", "lassokin_ros.node.node", "lassokin_ros.archive.tasks"])


class Forked:
    """As `subprocess.Popen` of [sys.executable, ...] with "-m", module, "-c", code or file, ..., without a stdin.

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


CLIENT = """import os, socket, sys
connection = socket.socket(socket.AF_UNIX)
connection.connect(sys.argv[1])
socket.send_fds(connection, ["\\0".join([os.getcwd(), *sys.argv[2:]]).encode()], [0, 1, 2])
sys.exit(int(connection.recv(9) or 1))"""


class ForkedCommands:
    """A process of which each `lassokin ...` in a shell of bash is a fork. A context: the shell's environment."""

    def __init__(self, environment, place):
        self._path, self._environment = str(place), environment
        start_server()
        self._process = CONTEXT.Process(target=_serve, args=(self._path, environment))

    def __enter__(self):
        self._process.start()
        call = f"{sys.executable} -I -S -c '{CLIENT}' {self._path} \"$@\""
        return {**self._environment, "BASH_FUNC_lassokin%%": f"() {{ {call}; }}"}

    def __exit__(self, *_):
        self._process.kill()
        self._process.join()


def _serve(path, environment):
    """Run the command of each connection in a process of its own, and answer with its exit code."""
    os.environ.update(environment)
    workers = _workers()
    multiprocessing.get_context = lambda _: workers  # of an archive's replay
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(path)
        server.listen()
        signal.signal(signal.SIGCHLD, signal.SIG_IGN)
        while True:
            connection, _ = server.accept()
            if os.fork():
                connection.close()
                continue
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            message, files, *_ = socket.recv_fds(connection, 65536, 3)
            child = os.fork()
            if child:
                connection.send(str(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])).encode())
                os._exit(0)
            for number, file in enumerate(files):
                os.dup2(file, number)
            sys.stdout, sys.stderr = (open(number, "w", encoding="utf-8", closefd=False) for number in (1, 2))
            folder, *arguments = message.decode().split("\0")
            os.chdir(folder)
            sys.argv = ["lassokin", *arguments]
            runpy.run_module("lassokin_ros.cli.lassokin", run_name="__main__", alter_sys=True)


def _workers():
    """A context of multiprocessing whose processes are forked, and close the other ends of the pipes."""
    fork, others = multiprocessing.get_context("fork"), []

    def pipe():
        ends = fork.Pipe()
        others.append(ends[0])
        return ends

    def process(target, args, daemon):
        def run(*given):
            for end in others:
                end.close()
            target(*given)

        return fork.Process(target=run, args=args, daemon=daemon)

    return SimpleNamespace(Pipe=pipe, Process=process)


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
    sys.stdout, sys.stderr = (open(number, "w", buffering=1, encoding="utf-8", closefd=False) for number in (1, 2))
    os.environ.clear()
    os.environ.update(environment)
    os.chdir(folder)
    paths = list(filter(None, environment.get("PYTHONPATH", "").split(os.pathsep)))
    first, *rest = arguments
    if first == "-m":
        sys.argv, sys.path[:0] = rest, [folder, *paths]
        runpy.run_module(rest[0], run_name="__main__", alter_sys=True)
    elif first == "-c":
        sys.argv, sys.path[:0] = ["-c", *rest[1:]], [folder, *paths]
        exec(compile(rest[0], "<string>", "exec"), {"__name__": "__main__"})
    else:
        sys.argv, sys.path[:0] = arguments, [str(Path(first).parent), *paths]
        runpy.run_path(first, run_name="__main__")
