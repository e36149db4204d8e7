"""Errors of usage and input, which end a benchmark with one line."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Callable

from lassokin_ros.common.command_line import missing_package
from lassokin_ros.core.errors import LassokinError


def exit_code(command: Callable[[], int | None]) -> int:
    """Exit code of a script: that of `command`, or 2 after one line with the reason."""
    try:
        return command() or 0
    except LassokinError as error:
        why = str(error)
    except ModuleNotFoundError as error:
        why = missing_package(error)
    except SystemExit as end:
        # argparse uses code 2 for usage errors. A SystemExit with a text would end with code 1, as a traceback does.
        if not isinstance(end.code, str):
            raise
        why = end.code
    print(f"{Path(sys.argv[0]).name}: {why}", file=sys.stderr)
    return 2
