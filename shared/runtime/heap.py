"""The C library's heap: what it keeps of what was freed."""

from __future__ import annotations

import ctypes

_LIBC = ctypes.CDLL(None)


def give_back() -> None:
    """Returns freed memory to the system, which glibc otherwise keeps for each thread that has used it.

    A burst of scans would stay with a process for good. Takes some milliseconds. Nothing where the library is another.
    Source: malloc_trim(3).
    """
    trim = getattr(_LIBC, "malloc_trim", None)
    if trim is not None:
        trim(0)
