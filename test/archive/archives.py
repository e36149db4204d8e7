"""Helpers of the archive tests: recordings, the command as a process, and the process that holds a recording."""

import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path

from recordings import write_recording

from lassokin_ros.cli.replay import main

ROOT = Path(__file__).resolve().parents[2]
LONG = 300
"""Number of frames that take a second: enough time to find and kill the process."""


def write_archive(folder, long=0):
    """Three short recordings and one that cannot be read; any number of long ones."""
    (folder / "day1").mkdir(parents=True)
    write_recording(folder / "day1" / "walk", 30)
    write_recording(folder / "day1" / "wave", 20, "sqlite3")
    write_recording(folder / "squat.v2", 25)
    (folder / "torn.mcap").write_bytes(b"no recording")
    for number in range(long):
        write_recording(folder / f"z_long{number}", LONG)
    return folder


def start_replay(*arguments, **options):
    """The command as a process, with readable output; it leads its own process group."""
    command = [sys.executable, "-m", "lassokin_ros.cli.replay", *map(str, arguments)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen(command, cwd=ROOT, start_new_session=True, **pipes, **options)


def holder(running, output, deadline_s=120.0, but=()):
    """The id of the process that writes the recording `output`: it has a file open in the hidden folder beside it.

    running: a process that must not end before, None if that is this process. but: processes to ignore. A process that
    removes the folder is ignored, too: it has the folder open, but no file.
    """
    deadline, hidden = time.monotonic() + deadline_s, str(output.parent.resolve() / f".{output.name}.")
    while time.monotonic() < deadline and (running is None or running.poll() is None):
        begun = output.parent.is_dir() and any(
            name.startswith(f".{output.name}.") for name in os.listdir(output.parent)
        )
        for process in _processes() if begun else ():
            if process not in but and _writes(process, hidden):
                return process
        time.sleep(0.02)
    if running is not None:
        running.kill()
    raise AssertionError(f"nobody has begun to write {output}: {running and running.communicate()}")


@contextmanager
def killed_writers(output, times):
    """A context in which the first processes that write `output` are killed; it is a list of those killed."""
    killed = []

    def kill():
        for _ in range(times):
            killed.append(holder(None, output, but=killed))
            os.kill(killed[-1], signal.SIGKILL)

    killer = threading.Thread(target=kill)
    killer.start()
    try:
        yield killed
    finally:
        killer.join()


def _processes():
    return [int(entry.name) for entry in Path("/proc").iterdir() if entry.name.isdigit()]


def _writes(process, hidden):
    return any(path.startswith(hidden) and os.path.isfile(path) for path in _open_files(process))


def _open_files(process):
    try:
        descriptors = list(Path(f"/proc/{process}/fd").iterdir())
    except OSError:
        return
    for descriptor in descriptors:
        try:
            yield os.readlink(descriptor)
        except OSError:
            continue


def outcomes(table):
    """{recording: result in its line} of a printed table."""
    lines = table.strip().splitlines()
    start = lines[0].index("result")
    return {line.split()[0]: line[start:] for line in lines[1:-1]}


def replayed(capsys, *arguments):
    """Exit code and table of the command, in this process."""
    code = main(list(map(str, arguments)))
    said = capsys.readouterr()
    return code, said.out
