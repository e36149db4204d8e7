"""The resources of a process, from Linux's /proc, and limits of them."""

from __future__ import annotations

import os
import resource
from dataclasses import dataclass
from pathlib import Path

TICKS_PER_S = os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True)
class Usage:
    """Resources at one moment: resident memory and address space in MB, descriptors, threads, processor time in s."""

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
