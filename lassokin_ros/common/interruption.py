"""Convert SIGINT and SIGTERM to an exception, so that an interrupted command cleans up."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from types import FrameType
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM)
REPEAT_S = 0.05
"""s: period in which a lost `Interrupted` is raised again."""


class Interrupted(BaseException):
    """SIGINT or SIGTERM. Not KeyboardInterrupt: Python exits when that passes through `exec`, even if it is caught."""


@contextmanager
def interruptible() -> Iterator[None]:
    """Raise Interrupted at the first signal in the block. Later signals are ignored, so that clean-up can finish.

    Python drops exceptions raised in destructors and in weak reference callbacks. Therefore Interrupted is raised again
    until it is handled. The block uses SIGALRM and the real interval timer.
    """
    report = sys.unraisablehook
    with _handled({**dict.fromkeys(SIGNALS, _interrupt), signal.SIGALRM: _interrupt_again}):
        sys.unraisablehook = lambda lost: None if issubclass(lost.exc_type, Interrupted) else report(lost)
        try:
            yield
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            sys.unraisablehook = report


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Hold SIGINT and SIGTERM back in the block and deliver the first one at its end.

    Use it for a step that must not be left half done, such as starting a child process.
    """
    waiting: list[int] = []
    try:
        with _handled(dict.fromkeys(SIGNALS, lambda received, _: waiting.append(received))):
            yield
    finally:
        for first in waiting[:1]:
            signal.raise_signal(first)


@contextmanager
def stop_flag() -> Iterator[list[int]]:
    """Yield a list that is not empty after SIGINT or SIGTERM. A second signal acts as usual."""
    received: list[int] = []

    def stop(number: int, _: object) -> None:
        received.append(number)
        for signal_number, handler in previous.items():
            signal.signal(signal_number, handler)

    with _handled(dict.fromkeys(SIGNALS, stop)) as previous:
        yield received


@contextmanager
def _handled(handlers: Mapping[int, Callable[[int, FrameType | None], object]]) -> Iterator[dict[int, Any]]:
    """Yield the former handlers of these signals, which handle them again after the block."""
    previous = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield previous
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    signal.setitimer(signal.ITIMER_REAL, REPEAT_S, REPEAT_S)
    raise Interrupted("nothing was written")


def _interrupt_again(_number: int, _frame: FrameType | None) -> None:
    # If Interrupted is in the context of the current exception, an `except`, `finally` or `__exit__` handles it.
    handled = sys.exc_info()[1]
    while handled is not None:
        if isinstance(handled, Interrupted):
            return
        handled = handled.__context__
    raise Interrupted("nothing was written")
