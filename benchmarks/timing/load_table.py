"""Rows of the soak test's table: memory, descriptors, threads and latencies at the begin and at the end."""

from __future__ import annotations

import numpy as np

from benchmarks.common.report import Record
from benchmarks.timing.processes import Usage

MOST_GROWTH_MB = 5.0
"""Largest permitted growth of memory, MB."""


def row(what: str, begin: object, end: object, holds: bool | None = None) -> Record:
    """One row of the table."""
    return {
        "what": what,
        "begin": str(begin),
        "end": str(end),
        "holds": "" if holds is None else "yes" if holds else "NO",
    }


def usage_rows(begin: Usage, end: Usage) -> list[Record]:
    """Rows for memory, descriptors and threads, which must not grow."""
    grown = end.memory_mb - begin.memory_mb
    return [
        row("memory, MB", f"{begin.memory_mb:.1f}", f"{end.memory_mb:.1f}", grown < MOST_GROWTH_MB),
        row("file descriptors", begin.descriptors, end.descriptors, end.descriptors <= begin.descriptors),
        row("threads", begin.threads, end.threads, end.threads <= begin.threads),
        row("address space, MB", f"{begin.address_space_mb:.0f}", f"{end.address_space_mb:.0f}"),
    ]


def latency_rows(what: str, times_ms: np.ndarray) -> list[Record]:
    """Rows for the percentiles of the first and the last tenth."""
    tenth = max(len(times_ms) // 10, 1)
    first, last = times_ms[:tenth], times_ms[-tenth:]
    return [
        row(f"{what} p{p}, ms, first and last tenth", f"{np.percentile(first, p):.2f}", f"{np.percentile(last, p):.2f}")
        for p in (50, 99)
    ]
