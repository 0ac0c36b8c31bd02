"""SIGTERM and Ctrl-C as something that is asked for."""

from __future__ import annotations

import os
import signal
from types import FrameType

from shared.runtime.exit_codes import Exit


class StopSignal:
    """Remembers the first SIGTERM or SIGINT; a further Ctrl-C ends the process at once.

    SIGTERM may come several times: the kernel sends it once for each dying thread of a parent that was killed.
    As a context manager it gives the signals back to whoever had them before.
    """

    def __init__(self) -> None:
        self.signum: int | None = None
        self._before = {signum: signal.signal(signum, self._on_signal) for signum in (signal.SIGTERM, signal.SIGINT)}

    def __enter__(self) -> StopSignal:
        return self

    def __exit__(self, *_: object) -> None:
        for signum, handler in self._before.items():
            signal.signal(signum, handler)

    def is_set(self) -> bool:
        """Whether the process shall end."""
        return self.signum is not None

    def exit_code(self) -> Exit:
        """130 after Ctrl-C, 0 after SIGTERM."""
        return Exit.INTERRUPTED if self.signum == signal.SIGINT else Exit.FINE

    def _on_signal(self, signum: int, _frame: FrameType | None) -> None:
        if self.signum is not None and signum == signal.SIGINT:
            os._exit(Exit.INTERRUPTED)
        self.signum = signum if self.signum is None else self.signum
