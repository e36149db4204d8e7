"""The command `lassokin replay`: run the tracker over one recording, or over an archive of recordings."""

from __future__ import annotations

import argparse
import errno
import os
import sys
from collections.abc import Sequence

from lassokin_ros.common.exit_codes import INTERRUPTED, USAGE_ERROR
from lassokin_ros.common.interruption import Interrupted, interruptible
from lassokin_ros.common.missing_package import missing_package
from lassokin_ros.common.summary_output import print_note, print_summary
from lassokin_ros.core.errors import LassokinError
from lassokin_ros.replay.options import PROGRAM, parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code.

    The code is 0 on success, 2 for input that cannot be used (with one line on stderr), and 130 after an interrupt.
    """
    options = parser().parse_args(arguments)
    if options.height is not None:
        options.p.append(f"height:={options.height}")
    # The matrices are small: more BLAS threads cost more time than they save. numpy is not imported yet.
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    try:
        with interruptible():
            return run(options)
    except OSError as error:
        if error.errno != errno.ENAMETOOLONG:
            raise
        print(f"{PROGRAM}: the name '{error.filename}' is too long for a file", file=sys.stderr)
        return USAGE_ERROR
    except LassokinError as error:
        print(f"{PROGRAM}: {error}", file=sys.stderr)
        return USAGE_ERROR
    except ImportError as error:
        print(f"{PROGRAM}: {missing_package(error)}", file=sys.stderr)
        return USAGE_ERROR
    except Interrupted as interrupted:
        print(f"{PROGRAM}: interrupted; {interrupted}", file=sys.stderr)
        return INTERRUPTED


def run(options: argparse.Namespace) -> int:
    """Replay one recording or an archive, and return the exit code. Raises a LassokinError."""
    from lassokin_ros.archive.archive import is_archive, replay_archive
    from lassokin_ros.replay.replay import replay

    if is_archive(options):
        return replay_archive(options)
    (options.bag,) = options.bags
    replayed = replay(options)
    print_summary(replayed.summary)
    if replayed.warning:
        print_note(f"{PROGRAM}: {replayed.warning}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
