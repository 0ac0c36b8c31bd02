"""Runs trajectories: the player as a child process, with the same configuration as the page."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from shared.runtime.children import ending_with_parent
from shared.runtime.exit_codes import Exit

_STOP_TIMEOUT_S = 5.0
_MAX_TEXT_BYTES = 4096


@dataclass(frozen=True, slots=True)
class _Run:
    """A player under way, and the file that takes what it complains of."""

    name: str
    process: subprocess.Popen[bytes]
    complaints: IO[bytes]

    def last_complaint(self) -> str:
        """The last line it wrote; empty if there is none."""
        self.complaints.seek(0)
        lines = self.complaints.read(_MAX_TEXT_BYTES).decode(errors="replace").strip().splitlines()
        return lines[-1] if lines else ""


class PlayerProcess:
    """At most one player at a time. It ends with this process, also when that is killed.

    trajectories: files by name. arguments: what the player takes besides its file (--config, --set ...).
    """

    def __init__(self, trajectories: Mapping[str, Path], arguments: Sequence[str]) -> None:
        self._trajectories = trajectories
        self._arguments = list(arguments)
        self._run: _Run | None = None

    def follow(self, wanted: str | None) -> str | None:
        """Starts or ends the player so that the wanted trajectory runs; how it ended, if it did so by itself."""
        if wanted is None:
            self.stop()
            return None
        if self._run is None:
            self._run = self._started(wanted)
        return self._ending(self._run)

    def stop(self) -> None:
        """Ends the player, if there is one. Idempotent."""
        run, self._run = self._run, None
        if run is None:
            return
        run.process.terminate()
        try:
            run.process.wait(_STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            run.process.kill()
            run.process.wait()
        run.complaints.close()

    def _started(self, name: str) -> _Run:
        complaints = tempfile.TemporaryFile()  # noqa: SIM115 - closed when the player has ended
        process = subprocess.Popen(  # noqa: S603 - our own module
            [
                *(sys.executable, "-m", "services.player", "-q"),
                *self._arguments,
                *("--set", f"player.trajectory={self._trajectories[name]}"),
            ],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=complaints,
            start_new_session=True,
            preexec_fn=ending_with_parent(),
        )
        return _Run(name, process, complaints)

    def _ending(self, run: _Run) -> str | None:
        code = run.process.poll()
        if code is None:
            return None
        text = "done" if code == Exit.FINE else run.last_complaint() or f"ended with exit code {code}"
        run.complaints.close()
        self._run = None
        return f"trajectory {run.name}: {text}"
