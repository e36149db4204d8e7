"""Print notes and the summary of finished work. An error of printing is reported as such, not as failed work."""

from __future__ import annotations

import io
import os
import sys
from contextlib import suppress

from lassokin_ros.core.errors import LassokinError


class SummaryError(LassokinError):
    """The work is done, but its summary cannot be written to stdout."""


def print_summary(text: str) -> None:
    """Print to stdout and flush. A closed pipe is ignored. Raises SummaryError for other failures."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # file names may contain bytes that cannot be encoded
    try:
        print(text, flush=True)
    except OSError as error:
        _discard_stdout()
        if not isinstance(error, BrokenPipeError):
            reason = error.strerror or error
            raise SummaryError(f"the work is done, but its summary cannot be printed: {reason}") from None


def print_note(text: str) -> None:
    """Print a note to stderr. Errors of stderr (closed, full) are ignored."""
    with suppress(OSError, ValueError, AttributeError):
        print(text, file=sys.stderr, flush=True)


def _discard_stdout() -> None:
    """Redirect stdout to /dev/null: the buffered text would fail again, with a traceback, when Python exits."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)
