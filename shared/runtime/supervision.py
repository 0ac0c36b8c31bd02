"""Keeps one process running: starts it, hears its pulse, starts it again when it ends or freezes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import structlog

from shared.runtime.children import ending_with_parent
from shared.runtime.notify import NotifySocket
from shared.runtime.process_load import is_at_work
from shared.runtime.restarts import PULSE_LIMIT_S, RestartPolicy

POLL_S = 0.05
"""How often a supervisor looks."""
_MAX_STEP_S = 0.5
_STOP_TIMEOUT_S = 10.0
_NUM_LAST_LINES = 3

log = structlog.get_logger()


@dataclass(frozen=True, slots=True)
class Comeback:
    """A process that failed and does its work again. away_s: from its last sign of life on."""

    name: str
    reason: str
    away_s: float
    num_restarts: int

    @property
    def text(self) -> str:
        """For people."""
        times = "restart" if self.num_restarts == 1 else "restarts"
        return f"{self.name} {self.reason}; it is back after {self.away_s:.1f} s ({self.num_restarts} {times})"


class PatientClock:
    """Seconds in which the supervisor itself was awake: what it slept through, nobody is blamed for."""

    def __init__(self) -> None:
        self._last_s = time.monotonic()
        self._watched_s = 0.0

    def now_s(self) -> float:
        """To be asked at each look."""
        now_s = time.monotonic()
        self._watched_s += min(now_s - self._last_s, _MAX_STEP_S)
        self._last_s = now_s
        return self._watched_s


class Supervised:
    """One process, over its restarts.

    name: for people. arguments: of Python. log_path: where it writes; None = to this process's stderr. The thread that
    builds it must be the one that steps it, and live as long as the process shall.
    """

    def __init__(self, name: str, arguments: list[str], now_s: float, *, log_path: Path | None = None) -> None:
        self.name = name
        self.num_restarts = 0
        self.failure: str | None = None
        """Why it was given up."""
        self.exit_code: int | None = None
        """Of the process that ended last."""
        self._arguments, self._log_path = arguments, log_path
        self._policy = RestartPolicy()
        self._process: subprocess.Popen[bytes] | None = None
        self._overdue: str | None = None
        self._restart_s = self._failed_s = now_s
        self._reason = ""
        self._start(now_s)

    @property
    def pid(self) -> int | None:
        """Of the process that runs now."""
        return self._process.pid if self._process is not None else None

    @property
    def is_ready(self) -> bool:
        """Whether it does its work now, as far as is known."""
        return self._process is not None and self._policy.is_ready

    def step(self, now_s: float) -> Comeback | None:
        """Looks once: hears the process, kills it if it is frozen, starts it again when it is time.

        Returns what to say when a process that was started again is ready. Once `failure` is set nothing happens.
        """
        if self.failure is not None:
            return None
        if self._process is None:
            if now_s >= self._restart_s:
                self.num_restarts += 1
                self._start(now_s)
            return None
        was_ready = self._policy.is_ready
        self._hear(now_s)
        if (exit_code := self._process.poll()) is not None:
            self._has_ended(now_s, exit_code, self._overdue or _ending(exit_code))
        elif self._overdue is None and (overdue := self._policy.overdue(now_s, self._is_at_work)) is not None:
            self._overdue = overdue
            self._process.kill()
        elif self.num_restarts and self._policy.is_ready and not was_ready:
            comeback = Comeback(self.name, self._reason, now_s - self._failed_s, self.num_restarts)
            log.warning(comeback.text, service="supervisor")
            return comeback
        return None

    def stop(self) -> None:
        """Ends the process: SIGTERM, and SIGKILL if that is not enough. Idempotent."""
        process, self._process = self._process, None
        if process is None:
            return
        process.terminate()
        try:
            self.exit_code = process.wait(_STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            self.exit_code = process.wait()
        self._socket.close()

    def _start(self, now_s: float) -> None:
        self._socket = NotifySocket()
        self._words, self._overdue = "", None
        output = None
        if self._log_path is not None:
            self._log_path.parent.mkdir(parents=True, exist_ok=True)
            output = self._log_path.open("ab" if self.num_restarts else "wb")
        try:
            # In a session of its own, so that Ctrl-C reaches the supervisor alone and it decides the order.
            self._process = subprocess.Popen(  # noqa: S603 - our own modules
                [sys.executable, *self._arguments],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT if output else None,
                env={**os.environ, **self._socket.environment(PULSE_LIMIT_S)},
                start_new_session=True,
                preexec_fn=ending_with_parent(),
            )
        finally:
            if output is not None:
                output.close()
        self._policy.started(now_s)

    def _hear(self, now_s: float) -> None:
        assert self._process is not None
        for name, value in self._socket.received(self._process.pid):
            if name == "READY":
                self._policy.ready(now_s)
            elif name == "WATCHDOG":
                self._policy.pulsed(now_s)
            elif name == "STATUS":
                self._words = value

    def _is_at_work(self) -> bool:
        return self._process is not None and is_at_work(self._process.pid)

    def _has_ended(self, now_s: float, exit_code: int, reason: str) -> None:
        self._process, self.exit_code = None, exit_code
        self._socket.close()
        self._reason = reason
        if self._policy.is_ready:
            self._failed_s = self._policy.pulse_s
        restart_s = self._policy.failed(now_s, exit_code)
        words = self._last_words()
        if restart_s is None:
            times = f" (given up after {self.num_restarts} restarts)" if self.num_restarts else ""
            self.failure = f"{self.name} {reason}{times}{words}"
            return
        self._restart_s = restart_s
        delay_s = restart_s - now_s
        when = f"in {delay_s:g} s" if delay_s else "now"
        log.warning(f"{self.name} {reason}, is started again {when}{words}", service="supervisor")

    def _last_words(self) -> str:
        """The end of its log, or what it said of itself."""
        if self._log_path is None:
            return f": {self._words}" if self._words else ""
        lines = self._log_path.read_text(errors="replace").strip().splitlines()[-_NUM_LAST_LINES:]
        return f" (see {self._log_path}): " + " | ".join(lines)


def _ending(exit_code: int) -> str:
    if exit_code >= 0:
        return f"ended with exit code {exit_code}"
    try:
        return f"was killed by {signal.Signals(-exit_code).name}"
    except ValueError:
        return f"was killed by signal {-exit_code}"
