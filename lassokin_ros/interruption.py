"""How a command is interrupted: SIGINT and SIGTERM become an exception, so that what is half done is cleaned up."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Interrupted(BaseException):
    """SIGINT or SIGTERM. Not KeyboardInterrupt: when that passes through `exec`, Python dies of it though caught."""


@contextmanager
def interruptible() -> Iterator[None]:
    """Within, the first signal raises Interrupted; later ones are ignored, since they would stop the cleaning up."""
    previous = [signal.signal(number, _interrupt) for number in SIGNALS]
    try:
        yield
    finally:
        for number, handler in zip(SIGNALS, previous):
            signal.signal(number, handler)


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    raise Interrupted("nothing was written")
