"""The shared memory that large messages pass through, as the machine sees it: segments in a folder, and who owns them.

Zenoh keeps a segment as long as anybody has it open, and readers never close one: the memory of an ended process would
stay taken until the router and all readers end. So each owner holds a lock beside its segment as long as it lives,
however it ends, and the next owner empties what nobody holds any more.
"""

from __future__ import annotations

import contextlib
import fcntl
import mmap
import os
from collections.abc import Iterator
from pathlib import Path
from typing import IO

FOLDER = Path("/dev/shm")  # noqa: S108 - where POSIX shared memory is
_SEGMENT, _OWNER = ".zenoh", ".zenoh-owner"


def bus_memory_bytes(folder: Path = FOLDER) -> int:
    """What all of Zenoh's segments on this machine, or in this container, have in use; 0 where there is no folder."""
    total = 0
    for path in folder.glob(f"*{_SEGMENT}"):
        try:
            total += path.stat().st_blocks * 512  # POSIX: blocks of stat have 512 bytes
        except FileNotFoundError:  # gone since
            continue
    return total


def mapped_segments(folder: Path = FOLDER) -> set[Path]:
    """Zenoh's segments that this process has in its memory: its own, and those it reads from."""
    names = (line.rpartition(" ")[2] for line in Path("/proc/self/maps").read_text().splitlines())
    return {Path(name) for name in names if name.startswith(f"{folder}/") and name.endswith(_SEGMENT)}


def own(segment: Path) -> IO[bytes]:
    """Says that this process owns the segment until it ends, or closes what is returned.

    Raises:
        OSError: the folder of the segment cannot be written to.
    """
    mark = segment.with_suffix(_OWNER)
    unfinished = mark.with_suffix(f".{os.getpid()}")
    lock = unfinished.open("wb")
    fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    unfinished.rename(mark)  # now it can be found, and is locked already
    return lock


def empty_abandoned(folder: Path = FOLDER) -> int:
    """Gives back the memory of segments whose owner has ended, also where others still have them open.

    Returns how many there were. Who reads one from then on reads zeros.
    """
    num_emptied = 0
    for mark in folder.glob(f"*{_OWNER}"):
        with contextlib.suppress(OSError), mark.open("rb") as lock:  # gone since, another user's, or its owner lives
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            with contextlib.suppress(FileNotFoundError), _mapped(mark.with_suffix(_SEGMENT)) as memory:
                memory.madvise(mmap.MADV_REMOVE)
                num_emptied += 1
            mark.unlink()
    return num_emptied


@contextlib.contextmanager
def _mapped(path: Path) -> Iterator[mmap.mmap]:
    with path.open("r+b") as file, mmap.mmap(file.fileno(), 0) as memory:
        yield memory
