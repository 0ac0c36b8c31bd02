"""Exit codes of every command and service."""

from enum import IntEnum


class Exit(IntEnum):
    """0 fine, 1 failed, 2 wrong usage or configuration, 3 partial result, 130 stopped by Ctrl-C."""

    FINE = 0
    FAILED = 1
    USAGE = 2
    PARTIAL = 3
    INTERRUPTED = 130
