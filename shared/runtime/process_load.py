"""What a process costs its machine: processor, memory, open files."""

from __future__ import annotations

import contextlib
import time
from dataclasses import dataclass
from pathlib import Path

import psutil

_AT_WORK = "RD"
"""States of proc(5): running or runnable, waiting for a disk."""


@dataclass(frozen=True, slots=True)
class Load:
    """cpu_ratio: of one core since the last look. shared_memory_bytes: of rss_bytes, what is shared with others."""

    cpu_ratio: float
    rss_bytes: int
    shared_memory_bytes: int
    num_open_files: int
    num_threads: int


def is_at_work(pid: int) -> bool:
    """Whether a thread of the process runs, waits for a processor, or for a disk: it is neither stopped nor asleep."""
    for stat in Path(f"/proc/{pid}/task").glob("*/stat"):
        with contextlib.suppress(OSError):  # the thread has ended since
            state = stat.read_text().rpartition(")")[2].split()[0]  # proc(5): the name before it may hold anything
            if state in _AT_WORK:
                return True
    return False


class ProcessLoad:
    """Looks at one process, this one unless told otherwise."""

    def __init__(self, pid: int | None = None) -> None:
        self._process = psutil.Process(pid)
        self._status = Path(f"/proc/{self._process.pid}/status")
        self._last_s, self._last_cpu_s = time.monotonic(), self._cpu_s()

    def look(self) -> Load:
        """The load now, and the processor's since the last look.

        Raises:
            psutil.NoSuchProcess: it has ended.
        """
        now_s, cpu_s = time.monotonic(), self._cpu_s()
        cpu_ratio = (cpu_s - self._last_cpu_s) / max(now_s - self._last_s, 1e-9)
        self._last_s, self._last_cpu_s = now_s, cpu_s
        return Load(
            cpu_ratio=cpu_ratio,
            rss_bytes=self._process.memory_info().rss,
            shared_memory_bytes=self._shared_memory_bytes(),
            num_open_files=self._process.num_fds(),
            num_threads=self._process.num_threads(),
        )

    def _cpu_s(self) -> float:
        times = self._process.cpu_times()
        return float(times.user + times.system)

    def _shared_memory_bytes(self) -> int:
        """Resident pages of /dev/shm, which neither libraries nor the heap are part of; 0 where no kernel tells."""
        try:
            lines = self._status.read_text().splitlines()
        except OSError:
            return 0
        found = (line.split() for line in lines if line.startswith("RssShmem:"))
        return next((int(words[1]) * 1024 for words in found), 0)
