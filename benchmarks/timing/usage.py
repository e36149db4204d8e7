"""The resources of a process, from Linux's /proc, their limits, and the rows of the soak test's table about them."""

from __future__ import annotations

import os
import resource
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.common.report import Record

TICKS_PER_S = os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True)
class Usage:
    """Use at one moment: resident memory in MB, descriptors, threads, processor time in s, address space in MB."""

    memory_mb: float
    descriptors: int
    threads: int
    cpu_s: float
    address_space_mb: float = 0.0

    @classmethod
    def of(cls, pid: int | str = "self") -> Usage:
        """Resources of a running process of this user."""
        folder = Path("/proc") / str(pid)
        status = dict(line.split(":", 1) for line in (folder / "status").read_text(encoding="utf-8").splitlines())
        times = (folder / "stat").read_text(encoding="utf-8").rpartition(")")[2].split()
        return cls(
            int(status["VmRSS"].split()[0]) / 1024,
            len(list((folder / "fd").iterdir())),
            int(status["Threads"]),
            (int(times[11]) + int(times[12])) / TICKS_PER_S,
            int(status["VmSize"].split()[0]) / 1024,
        )


@dataclass(frozen=True)
class Limits:
    """Limits of a process: address space in MB (RLIMIT_AS) and open file descriptors (RLIMIT_NOFILE), 0 = none."""

    address_space_mb: int = 0
    descriptors: int = 0

    def apply(self) -> None:
        """Set them for this process, and for those that it starts later. Raises ValueError beyond a hard limit."""
        limits = {resource.RLIMIT_AS: self.address_space_mb << 20, resource.RLIMIT_NOFILE: self.descriptors}
        for kind, number in limits.items():
            if number:
                resource.setrlimit(kind, (number, number))


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
