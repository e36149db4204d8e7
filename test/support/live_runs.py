"""Run the tests with running nodes several times, also beside busy loops, and print a line per run.

As in `make test`, as many processes as there are cores share them, file by file.

python test/support/live_runs.py [--runs 10] [--load 2] [FILE ...]
"""

import argparse
import os
import re
import resource
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
REAL = re.compile(r'^\s*from (live|archives) import|importorskip\("rclpy', re.MULTILINE)
"""Found in the text of tests that run nodes, or commands that work on all cores."""
BUSY = "import os\nparent = os.getppid()\nwhile os.getppid() == parent: pass"


def runs_nodes(path):
    """True if a test file runs nodes."""
    return REAL.search(path.read_text(encoding="utf-8")) is not None


@contextmanager
def busy(count):
    """Processes that use a core each."""
    loops = [subprocess.Popen([sys.executable, "-c", BUSY]) for _ in range(count)]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


def processor_time():
    """s: used by all child processes that have ended, and by theirs."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def run(files, number):
    """Run the tests once and print the result; the output is printed if one fails. Return True if none failed."""
    shared = ["--numprocesses", str(os.cpu_count()), "--dist", "loadgroup", "--no-loadscope-reorder"]
    command = [sys.executable, "-m", "pytest", *shared, "-p", "no:cacheprovider", "-v", "--tb=short", *files]
    started, used = time.monotonic(), processor_time()
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    if done.returncode:
        print(done.stdout[-20_000:], done.stderr[-5_000:])
    last = done.stdout.strip().rpartition("\n")[2].strip("= ")
    result = last if " in " in last else f"exit code {done.returncode}"
    print(
        f"run {number}: {result}; {time.monotonic() - started:.0f} s, {processor_time() - used:.0f} s of CPU",
        flush=True,
    )
    return done.returncode == 0


def main():
    """Print the result of each run and their number; the exit code is 1 if a test failed in one of them."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--load", type=int, default=0, help="number of busy loops")
    parser.add_argument("files", nargs="*", help="all that run nodes if none is given")
    options = parser.parse_args()
    files = options.files or sorted(str(path) for path in (ROOT / "test").rglob("test_*.py") if runs_nodes(path))
    with busy(options.load):
        green = sum(run(files, number) for number in range(1, options.runs + 1))
    print(f"{green} of {options.runs} runs without a failure, beside {options.load} busy loops")
    return int(green < options.runs)


if __name__ == "__main__":
    sys.exit(main())
