"""What the commands share: exit codes, one line for each error, notes, the summary, and the version.

numpy is not imported here, so that a command can set the number of its threads before.
"""

from __future__ import annotations

import errno
import io
import os
import sys
from collections.abc import Callable
from contextlib import suppress

from lassokin_ros.common.interruption import Interrupted, interruptible
from lassokin_ros.core.errors import LassokinError

USAGE_ERROR = 2
"""Exit code of a command that cannot be run as it was given; one line on stderr says why."""
INTERRUPTED = 130
"""Exit code after Ctrl-C; what was written until then is complete."""
FROM_PIP = ("proxsuite", "qpsolvers", "numpy", "scipy", "yaml", "rosbags", "cv2", "matplotlib", "pink", "pinocchio")
"""Packages that pip installs, with any installation of ROS. The first two exist only for pip."""
PIP_NAMES = {"yaml": "PyYAML", "cv2": "opencv-python-headless", "pink": "pin-pink", "pinocchio": "pin-pink"}


class SummaryError(LassokinError):
    """The work is done, but its summary cannot be written to stdout."""


def run_command(program: str, work: Callable[[], int]) -> int:
    """Return the exit code of `work`; with a line on stderr USAGE_ERROR after an error, INTERRUPTED after a signal."""
    # The matrices are small: more BLAS threads cost more time than they save.
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    try:
        with interruptible():
            return work()
    except OSError as error:
        if error.errno != errno.ENAMETOOLONG:
            raise
        line, code = f"the name '{error.filename}' is too long for a file", USAGE_ERROR
    except LassokinError as error:
        line, code = str(error), USAGE_ERROR
    except ImportError as error:
        line, code = missing_package(error), USAGE_ERROR
    except Interrupted as interrupted:
        line, code = f"interrupted; {interrupted}", INTERRUPTED
    print(f"{program}: {line}", file=sys.stderr)
    return code


def missing_package(error: ImportError) -> str:
    """Return one line for the user: which package is missing, and how to install it."""
    module = (error.name or "").partition(".")[0]
    if module in FROM_PIP:
        name = PIP_NAMES.get(module, module)
        in_environment = sys.prefix != sys.base_prefix
        install = "pip install" if in_environment else "pip install --break-system-packages"
        return f"the Python package {name} is not installed: {install} {name}"
    return f"{error}; the node needs ROS 2's rclpy and common_interfaces, see the README"


def one_line(error: Exception, most: int = 160) -> str:
    """Return the text of an exception of another library in one line. most: characters."""
    return " ".join(str(error).split())[:most]


def print_summary(text: str) -> None:
    """Print to stdout and flush. A closed pipe is ignored. Raises SummaryError for other failures."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # file names may contain bytes that cannot be encoded
    try:
        print(text, flush=True)
    except OSError as error:
        # The buffered text would fail again, with a traceback, when Python exits: it goes to /dev/null.
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)
        if not isinstance(error, BrokenPipeError):
            reason = error.strerror or error
            raise SummaryError(f"the work is done, but its summary cannot be printed: {reason}") from None


def print_note(text: str) -> None:
    """Print a note to stderr. Errors of stderr (closed, full) are ignored."""
    with suppress(OSError, ValueError, AttributeError):
        print(text, file=sys.stderr, flush=True)


def version() -> str:
    """Return the version of the installed package; "(not installed)" if it runs from the source folder."""
    from importlib import metadata

    try:
        return metadata.version("lassokin_ros")
    except metadata.PackageNotFoundError:
        return "(not installed)"
