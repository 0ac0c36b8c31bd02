"""Child processes that never outlive their parent."""

from __future__ import annotations

import ctypes
import os
import signal
from collections.abc import Callable

_PR_SET_PDEATHSIG = 1  # linux/prctl.h
_LIBC = ctypes.CDLL(None)


def ending_with_parent() -> Callable[[], None]:
    """For `preexec_fn`: SIGTERM when the parent, or its thread that calls this, is gone; no process is left behind."""
    parent_pid = os.getpid()  # 1 in a container

    def end_with_parent() -> None:
        _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
        if os.getppid() != parent_pid:
            os._exit(1)

    return end_with_parent
