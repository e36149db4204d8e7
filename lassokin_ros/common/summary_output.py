"""What a command prints when its work is done: that it cannot be printed must not look like work that failed."""

from __future__ import annotations

import io
import os
import sys

from lassokin_ros.core.errors import LassokinError


class SummaryError(LassokinError):
    """The work is done, but what is to be said of it cannot be written to stdout."""


def print_summary(text: str) -> None:
    """Print on stdout, at once; quietly nothing when its reader has gone. Raises SummaryError."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # files' names may hold what no encoding has
    try:
        print(text, flush=True)
    except OSError as error:
        _turn_away()
        if not isinstance(error, BrokenPipeError):
            raise SummaryError(f"the work is done, its summary cannot be printed: {error.strerror or error}") from None


def _turn_away() -> None:
    """Point stdout to nowhere: what waits in it would fail again, with a traceback, when Python ends."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)
