"""How a command is interrupted: SIGINT and SIGTERM become an exception, so that what is half done is cleaned up."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM)
AGAIN_S = 0.05
"""After this it is raised again where it got lost."""


class Interrupted(BaseException):
    """SIGINT or SIGTERM. Not KeyboardInterrupt: when that passes through `exec`, Python dies of it though caught."""


@contextmanager
def interruptible() -> Iterator[None]:
    """Within, the first signal raises Interrupted; later ones are ignored, since they would stop the cleaning up.

    Python drops what is raised within a destructor or a weak reference's callback, and a signal may come just then:
    Interrupted is raised again until it is being handled. Uses SIGALRM and the real interval timer meanwhile.
    """
    handlers = {**dict.fromkeys(SIGNALS, _interrupt), signal.SIGALRM: _interrupt_again}
    previous = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    tell = sys.unraisablehook
    sys.unraisablehook = lambda lost: None if issubclass(lost.exc_type, Interrupted) else tell(lost)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        sys.unraisablehook = tell
        for number, handler in previous.items():
            signal.signal(number, handler)


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Within, SIGINT and SIGTERM wait, and the first comes at the end: for a step that must not be left half done.

    A process that is being started, for one, is nobody's when what starts it is interrupted.
    """
    waiting: list[int] = []
    previous = {number: signal.signal(number, lambda received, _: waiting.append(received)) for number in SIGNALS}
    try:
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
        for first in waiting[:1]:
            signal.raise_signal(first)


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    signal.setitimer(signal.ITIMER_REAL, AGAIN_S, AGAIN_S)
    raise Interrupted("nothing was written")


def _interrupt_again(_number: int, _frame: FrameType | None) -> None:
    # Code that runs while an exception is on its way out is an `except`, a `finally` or an `__exit__`.
    handled = sys.exc_info()[1]
    while handled is not None:
        if isinstance(handled, Interrupted):
            return
        handled = handled.__context__
    raise Interrupted("nothing was written")
