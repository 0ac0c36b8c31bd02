"""Single keys of a terminal, without Enter."""

from __future__ import annotations

import os
import select
import sys
import termios
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager

LEFT, RIGHT = "\x1b[D", "\x1b[C"
_MAX_KEY_BYTES = 8


@contextmanager
def keys() -> Iterator[Callable[[], str]]:
    """Gives a function that returns the key pressed since it was last asked, or ""; always "" without a terminal."""
    if not sys.stdin.isatty():
        yield str
        return
    fd = sys.stdin.fileno()
    before = termios.tcgetattr(fd)
    tty.setcbreak(fd)

    def pressed() -> str:
        is_ready = bool(select.select([fd], [], [], 0)[0])
        return os.read(fd, _MAX_KEY_BYTES).decode(errors="replace") if is_ready else ""

    try:
        yield pressed
    finally:
        termios.tcsetattr(fd, termios.TCSADRAIN, before)
