"""When a process counts as failed, and when it is started again. Told times; knows no clock and no process."""

from __future__ import annotations

from collections.abc import Callable

from shared.runtime.exit_codes import Exit

PULSE_LIMIT_S = 1.2
"""No pulse for so long, and nothing done: frozen."""
MAX_STARVED_S = 10.0
"""No pulse for so long from a process that is at work: on a machine with too much to do its pulse comes late."""
READY_LIMIT_S = 60.0
_BACK_OFF_S = (0.0, 0.5, 1.0, 2.0, 4.0)
"""Of what fails soon after each start. What has worked for `_SETTLED_AFTER_S` is started again at once."""
_SETTLED_AFTER_S = 10.0
_WINDOW_S = 60.0
_FORGIVEN_AFTER_S = 30.0


class RestartPolicy:
    """Of one process. All times are seconds of one clock."""

    def __init__(self) -> None:
        self._started_s = 0.0
        self._ready_s: float | None = None
        self.pulse_s = 0.0
        """Its last sign of life, since it was ready."""
        self._restarts_s: list[float] = []

    @property
    def is_ready(self) -> bool:
        """Whether the process that runs has said that it is."""
        return self._ready_s is not None

    def started(self, now_s: float) -> None:
        """The process was started, for the first time or again."""
        self._started_s, self._ready_s = now_s, None

    def ready(self, now_s: float) -> None:
        """It says that it does its work."""
        self._ready_s = self.pulse_s = now_s

    def pulsed(self, now_s: float) -> None:
        """It says that it is alive."""
        self.pulse_s = now_s

    def overdue(self, now_s: float, is_at_work: Callable[[], bool]) -> str | None:
        """Why a process that runs must be killed, or None. is_at_work: asked of one that is silent."""
        if self._ready_s is None:
            return f"was not ready after {READY_LIMIT_S:g} s" if now_s - self._started_s > READY_LIMIT_S else None
        silent_s = now_s - self.pulse_s
        if silent_s <= PULSE_LIMIT_S or (silent_s <= MAX_STARVED_S and is_at_work()):
            return None
        return f"gave no sign of life for {silent_s:.1f} s"

    def failed(self, now_s: float, exit_code: int) -> float | None:
        """The process has ended unasked. Returns when to start it again, or None to give up.

        After `_FORGIVEN_AFTER_S` of health all is forgotten. It is given up after five restarts within a minute, or
        five in a row that did not make it ready, and at once if its configuration is wrong.
        """
        if exit_code == Exit.USAGE:
            return None
        health_s = 0.0 if self._ready_s is None else now_s - self._ready_s
        if self._ready_s is not None:
            is_forgiven = health_s >= _FORGIVEN_AFTER_S
            self._restarts_s = [s for s in self._restarts_s if not is_forgiven and now_s - s < _WINDOW_S]
        if len(self._restarts_s) == len(_BACK_OFF_S):
            return None
        at_s = now_s + (0.0 if health_s >= _SETTLED_AFTER_S else _BACK_OFF_S[len(self._restarts_s)])
        self._restarts_s.append(at_s)
        return at_s
