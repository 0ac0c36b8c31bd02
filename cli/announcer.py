"""Says on `events` what the supervisor did, so that it is seen and recorded."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable
from queue import Empty, SimpleQueue

import structlog

from shared.errors import BusError
from shared.messaging.bus import Bus
from shared.messaging.channels import EVENTS, LEG_STATE
from shared.messaging.inbox import Inbox
from shared.messaging.messages import Event, Message, Severity
from shared.runtime.config import BusConfig
from shared.runtime.node import Context, Node
from shared.runtime.runner import ServiceLoop

NAME = "supervisor"
_TIMER_HZ = 4.0
_MAX_WAIT_S = 10.0
_CLOSE_TIMEOUT_S = 10.0

log = structlog.get_logger()


class Announcer:
    """A thread with a session of its own, since a router that is away must not hold up the supervisor.

    An event waits until all `services` are on the bus, at most `_MAX_WAIT_S`: a router that has just come back reaches
    nobody yet.
    """

    def __init__(self, config: BusConfig, services: Iterable[str]) -> None:
        self._config, self._services = config, frozenset(services)
        self._events: SimpleQueue[tuple[Severity, str]] = SimpleQueue()
        self._waits_since_s: float | None = None
        self._stamp_ns = 0
        self._is_closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="announcer", daemon=True)

    def start(self) -> None:
        """To be called when the recorder is ready: what is said before goes out then."""
        self._thread.start()

    def say(self, severity: Severity, text: str) -> None:
        """Lets an event go out."""
        self._events.put((severity, text))

    def close(self) -> None:
        """Sends what still waits."""
        self._is_closing.set()
        if self._thread.is_alive():
            self._thread.join(_CLOSE_TIMEOUT_S)

    def _run(self) -> None:
        try:
            with Bus(self._config, name=NAME, is_stopping=self._is_closing.is_set) as bus:
                node = Node(
                    name=NAME,
                    inputs={LEG_STATE: self._note_time},
                    on_timer=lambda: self._waiting_events() if self._is_time(bus) else [],
                    timer_hz=_TIMER_HZ,
                    on_stop=self._waiting_events,
                )
                context = Context(clock_ns=time.monotonic_ns)
                ServiceLoop(node, bus, context, Inbox()).run(self._is_closing.is_set)
        except BusError as error:
            if not self._is_closing.is_set():
                log.warning("restarts will not be recorded", reason=str(error), service=NAME)

    def _note_time(self, message: Message) -> list[Message]:
        """Of simulated time, ten times a second: events need no better."""
        self._stamp_ns = message.stamp_ns  # type: ignore[attr-defined]
        return []

    def _is_time(self, bus: Bus) -> bool:
        if self._events.empty():
            return False
        now_s = time.monotonic()
        self._waits_since_s = self._waits_since_s or now_s
        is_heard = bus.is_wanted(EVENTS) and self._services <= bus.alive()
        if not is_heard and now_s - self._waits_since_s < _MAX_WAIT_S:
            return False
        self._waits_since_s = None
        return True

    def _waiting_events(self) -> list[Event]:
        events = []
        try:
            while True:
                severity, text = self._events.get_nowait()
                events.append(
                    Event(stamp_ns=self._stamp_ns, seq=0, frame="", source=NAME, severity=severity, text=text)
                )
        except Empty:
            return events
