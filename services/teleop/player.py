"""Runs trajectories: the player as a child process, with the same configuration as the page."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from shared.runtime.children import end_with_parent
from shared.runtime.exit_codes import Exit

_STOP_TIMEOUT_S = 5.0
_MAX_TEXT_BYTES = 4096


class PlayerProcess:
    """At most one player at a time. It ends with this process, also when that is killed.

    trajectories: files by name. arguments: what the player takes besides its file (--config, --set ...).
    """

    def __init__(self, trajectories: Mapping[str, Path], arguments: Sequence[str]) -> None:
        self._trajectories = trajectories
        self._arguments = list(arguments)
        self._process: subprocess.Popen[bytes] | None = None
        self._name = ""
        self._complaints = tempfile.TemporaryFile()  # noqa: SIM115 - as long as this object lives

    def follow(self, wanted: str | None) -> str | None:
        """Starts or ends the player so that the wanted trajectory runs; how it ended, if it did so by itself."""
        if wanted is None:
            self.stop()
            return None
        if self._process is None:
            self._start(wanted)
        return self._ending()

    def stop(self) -> None:
        """Ends the player, if there is one. Idempotent."""
        process, self._process = self._process, None
        if process is None:
            return
        process.terminate()
        try:
            process.wait(_STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()

    def _start(self, name: str) -> None:
        self._complaints.seek(0)
        self._complaints.truncate()
        self._name = name
        override = f"player.trajectory={self._trajectories[name]}"
        self._process = subprocess.Popen(  # noqa: S603 - our own module
            [sys.executable, "-m", "services.player", "-q", *self._arguments, "--set", override],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=self._complaints,
            start_new_session=True,
            preexec_fn=end_with_parent,
        )

    def _ending(self) -> str | None:
        assert self._process is not None
        code = self._process.poll()
        if code is None:
            return None
        self._process = None
        if code == Exit.FINE:
            return f"trajectory {self._name}: done"
        self._complaints.seek(0)
        lines = self._complaints.read(_MAX_TEXT_BYTES).decode(errors="replace").strip().splitlines()
        return f"trajectory {self._name}: {lines[-1] if lines else f'ended with exit code {code}'}"
