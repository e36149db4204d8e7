"""The resources of a process, from Linux's /proc."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

TICKS_PER_S = os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True)
class Usage:
    """Resources at one moment: resident memory in MB, open file descriptors, threads, processor time so far in s."""

    memory_mb: float
    descriptors: int
    threads: int
    cpu_s: float

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
        )
