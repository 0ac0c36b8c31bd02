"""The C library's heap: what it keeps of what was freed. Nothing is done where the library is another than glibc."""

from __future__ import annotations

import ctypes

_LIBC = ctypes.CDLL(None)
_M_ARENA_MAX = -8
_MAX_ARENAS = 2


def share_arenas() -> None:
    """Lets the threads of this process, which are tens, share two heaps. By default there are up to eight a processor.

    In each, what stays in use keeps the gaps around it from the system. Heaps that are there already stay.
    Source: mallopt(3).
    """
    option = getattr(_LIBC, "mallopt", None)
    if option is not None:
        option(_M_ARENA_MAX, _MAX_ARENAS)


def give_back() -> None:
    """Returns freed memory to the system, which glibc otherwise keeps for each thread that has used it.

    A burst of scans would stay with a process for good. Takes some milliseconds.
    Source: malloc_trim(3).
    """
    trim = getattr(_LIBC, "malloc_trim", None)
    if trim is not None:
        trim(0)
