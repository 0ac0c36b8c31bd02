"""`hyrecro top` on the bus: heartbeats and tokens in, tables or JSON out."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import asdict

from rich.console import Console, RenderableType
from rich.live import Live

from cli.keyboard import keys
from cli.top import Top
from cli.top_table import tables
from shared.errors import CodecError, MessageError
from shared.messaging.bus import Bus, is_reachable
from shared.messaging.channels import HEALTH
from shared.messaging.codec import decode
from shared.messaging.inbox import Inbox
from shared.messaging.messages import Health
from shared.runtime.config import BusConfig
from shared.runtime.shared_memory import bus_memory_bytes

_ONCE_S = 3.0
"""Two heartbeats of every service have come by then."""
_KEY_S = 0.1


class Watch:
    """The bus, watched: takes heartbeats while it waits."""

    def __init__(self, bus: Bus, config: BusConfig) -> None:
        self.top = Top()
        self._bus, self._config, self._inbox = bus, config, Inbox()
        self._is_routed = True
        bus.subscribe(HEALTH.every(), self._inbox)

    def wait(self, seconds: float, is_stopping: Callable[[], bool]) -> None:
        """Takes what comes for so long, or until `is_stopping`."""
        deadline_s = time.monotonic() + seconds
        while (left_s := deadline_s - time.monotonic()) > 0 and not is_stopping():
            if (parcel := self._inbox.take(min(left_s, _KEY_S))) is None:
                continue
            try:
                health = decode(Health, parcel.payload, schema=parcel.schema)
            except (CodecError, MessageError):  # of a service of another version: it shows as silent
                continue
            if not (parcel.is_replay and self.top.is_known(health.service)):
                self.top.add(health, parcel.received_ns * 1e-9)

    def look(self) -> None:
        """Asks who is alive."""
        self._is_routed = is_reachable(self._config.endpoint)
        self.top.set_alive(self._bus.alive() if self._is_routed else set())

    def title(self) -> str:
        """Where, how many services, and how much shared memory the bus has in use on this machine."""
        endpoint = self._config.endpoint
        if not self._is_routed:
            return f"{endpoint}: no router answers"
        rows = self.top.services(time.monotonic())
        num_ready = sum(row.state == "ready" for row in rows)
        memory = f"{bus_memory_bytes() / 1e6:.0f} MB of shared memory on this machine"
        return f"{endpoint}  {num_ready} of {len(rows)} ready  {memory}"

    def figures(self) -> dict[str, object]:
        """All of it, for programs."""
        return {
            "endpoint": self._config.endpoint,
            "bus_memory_bytes": bus_memory_bytes(),
            "services": [asdict(row) for row in self.top.services(time.monotonic())],
            "channels": [asdict(row) for row in self.top.channels()],
        }


def watch(
    config: BusConfig, *, interval_s: float, is_once: bool, is_json: bool, is_stopping: Callable[[], bool]
) -> None:
    """Shows the tables until `q` or `is_stopping`; once, or as JSON, as soon as rates are known.

    Raises:
        BusError: no router.
    """
    with Bus(config, is_stopping=is_stopping) as bus:
        watch = Watch(bus, config)
        if not (is_once or is_json):
            _show(watch, interval_s, is_stopping)
            return
        _collect(watch, is_stopping)
        if is_json:
            print(json.dumps(watch.figures()))
        else:
            Console().print(_tables(watch))


def snapshot(config: BusConfig) -> RenderableType:
    """The tables as they are when rates are known.

    Raises:
        BusError: no router.
    """
    with Bus(config) as bus:
        watch = Watch(bus, config)
        _collect(watch, lambda: False)
        return _tables(watch)


def _collect(watch: Watch, is_stopping: Callable[[], bool]) -> None:
    watch.look()
    watch.wait(_ONCE_S, lambda: is_stopping() or watch.top.is_complete)
    watch.look()


def _show(watch: Watch, interval_s: float, is_stopping: Callable[[], bool]) -> None:
    is_over = False
    with keys() as key, Live(console=Console(), screen=True, auto_refresh=False) as live:

        def is_quit() -> bool:
            nonlocal is_over
            is_over = is_over or is_stopping() or key() in ("q", "Q")
            return is_over

        while not is_over:
            watch.look()
            live.update(_tables(watch), refresh=True)
            watch.wait(interval_s, is_quit)


def _tables(watch: Watch) -> RenderableType:
    return tables(watch.title(), watch.top.services(time.monotonic()), watch.top.channels())
