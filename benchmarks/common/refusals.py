"""What ends a benchmark's command with one line: what its user asked for, or gave it, cannot be used."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Callable

from lassokin_ros.core.errors import LassokinError


def exit_code(command: Callable[[], int | None]) -> int:
    """What a script ends with: what `command` returns, or 2 after one line that says what was refused."""
    try:
        return command() or 0
    except LassokinError as error:
        why = str(error)
    except SystemExit as end:
        # A text as the code would end with 1, which is what a traceback ends with; argparse's own is 2 already.
        if not isinstance(end.code, str):
            raise
        why = end.code
    print(f"{Path(sys.argv[0]).name}: {why}", file=sys.stderr)
    return 2
