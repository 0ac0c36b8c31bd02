"""What `hyrecro top` knows: heartbeats, and the services and channels they tell of. No bus, no terminal."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field

from shared.messaging.channels import PREFIX
from shared.messaging.messages import ChannelCount, Health
from shared.messaging.values import MAX_SERVICES

SILENT_S = 2.0
"""Heartbeats come every second: a service without one for so long is said to be silent."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ServiceRow:
    """One service. Unknown figures are None: rates need two heartbeats, everything needs one.

    state: ready, silent, starting or gone. num_restarts: those seen. Counts are since the service was started; waiting
    in the inbox: now and, of the last second, the longest.
    """

    name: str
    state: str
    age_s: float | None = None
    uptime_s: float | None = None
    num_restarts: int = 0
    cpu_ratio: float | None = None
    busy_ratio: float | None = None
    rss_bytes: int | None = None
    shared_memory_bytes: int | None = None
    num_open_files: int | None = None
    num_threads: int | None = None
    received_hz: float | None = None
    sent_hz: float | None = None
    num_waiting: int = 0
    wait_max_s: float | None = None
    num_dropped: int = 0
    num_missed: int = 0
    num_refused: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Hearer:
    """Who takes a channel, how long its messages wait there, and what became of the others."""

    service: str
    wait_median_s: float | None
    wait_max_s: float | None
    num_waiting: int
    num_dropped: int
    num_missed: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelRow:
    """One key below `hyrecro/`, who publishes it and who takes it."""

    key: str
    rate_hz: float | None
    bytes_per_s: float | None
    publishers: tuple[str, ...]
    hearers: tuple[Hearer, ...]


@dataclass(slots=True)
class _Seen:
    heard_s: float
    health: Health
    before: Health | None = None
    num_restarts: int = 0

    @property
    def elapsed_s(self) -> float | None:
        return self.health.uptime_s - self.before.uptime_s if self.before is not None else None

    def rate(self, key: str, counter: str) -> float | None:
        """How much a second a counter of a key grew between the last two heartbeats."""
        if self.before is None or not self.elapsed_s:
            return None
        now, before = (_count(health, key) for health in (self.health, self.before))
        return float(getattr(now, counter) - getattr(before, counter)) / self.elapsed_s

    def total_rate(self, counter: str) -> float | None:
        rates = [self.rate(count.key, counter) for count in self.health.channels]
        return None if self.before is None else sum(rate for rate in rates if rate is not None)


@dataclass(slots=True)
class Top:
    """Follows every service. Times are seconds of any one clock."""

    _seen: dict[str, _Seen] = field(default_factory=dict)
    _alive: frozenset[str] = frozenset()

    def add(self, health: Health, now_s: float) -> None:
        """Notes a heartbeat."""
        last = self._seen.get(health.service)
        if last is None:
            if len(self._seen) < MAX_SERVICES:
                self._seen[health.service] = _Seen(now_s, health)
        elif health.uptime_s < last.health.uptime_s:
            self._seen[health.service] = _Seen(now_s, health, num_restarts=last.num_restarts + 1)
        else:
            self._seen[health.service] = _Seen(now_s, health, last.health, last.num_restarts)

    def is_known(self, service: str) -> bool:
        """Whether a heartbeat of it was noted."""
        return service in self._seen

    def set_alive(self, names: set[str]) -> None:
        """Notes which services hold their token."""
        self._alive = frozenset(names)

    @property
    def is_complete(self) -> bool:
        """Whether rates are known of every service that is alive."""
        seen = self._seen
        return bool(self._alive) and all(name in seen and seen[name].before is not None for name in self._alive)

    def services(self, now_s: float) -> list[ServiceRow]:
        """Every service that is alive or was ever heard, by name."""
        return [self._service(name, now_s) for name in sorted(self._alive | self._seen.keys())]

    def channels(self) -> list[ChannelRow]:
        """Every key that a living service sends or takes, by name."""
        publishers: defaultdict[str, list[str]] = defaultdict(list)
        hearers: defaultdict[str, list[Hearer]] = defaultdict(list)
        for name in sorted(self._alive & self._seen.keys()):
            for count in self._seen[name].health.channels:
                if count.num_sent:
                    publishers[count.key].append(name)
                if count.num_received or count.num_waiting or count.num_dropped:
                    hearers[count.key].append(_hearer(name, count))
        keys = sorted(publishers.keys() | hearers.keys())
        return [self._channel(key, tuple(publishers[key]), tuple(hearers[key])) for key in keys]

    def _service(self, name: str, now_s: float) -> ServiceRow:
        seen, is_alive = self._seen.get(name), name in self._alive
        if seen is None:
            return ServiceRow(name=name, state="silent")
        health, age_s = seen.health, now_s - seen.heard_s
        is_silent = age_s > SILENT_S
        states = {(True, False): "ready", (True, True): "silent", (False, False): "starting", (False, True): "gone"}
        waits_s = [count.wait_max_s for count in health.channels if count.wait_max_s is not None]
        return ServiceRow(
            name=name,
            state=states[is_alive, is_silent],
            age_s=age_s,
            uptime_s=health.uptime_s,
            num_restarts=seen.num_restarts,
            cpu_ratio=health.cpu_ratio,
            busy_ratio=health.busy_ratio,
            rss_bytes=health.rss_bytes,
            shared_memory_bytes=health.shared_memory_bytes,
            num_open_files=health.num_open_files,
            num_threads=health.num_threads,
            received_hz=seen.total_rate("num_received"),
            sent_hz=seen.total_rate("num_sent"),
            num_waiting=sum(count.num_waiting for count in health.channels),
            wait_max_s=max(waits_s, default=None),
            num_dropped=sum(count.num_dropped for count in health.channels),
            num_missed=sum(count.num_missed for count in health.channels),
            num_refused=sum(count.num_refused for count in health.channels),
        )

    def _channel(self, key: str, publishers: tuple[str, ...], hearers: tuple[Hearer, ...]) -> ChannelRow:
        def total(counter: str) -> float | None:
            rates = [self._seen[name].rate(key, counter) for name in publishers]
            return sum(rate for rate in rates if rate is not None) if rates and None not in rates else None

        return ChannelRow(
            key=key.removeprefix(PREFIX),
            rate_hz=total("num_sent"),
            bytes_per_s=total("num_bytes_sent"),
            publishers=publishers,
            hearers=hearers,
        )


def _count(health: Health, key: str) -> ChannelCount:
    return next((count for count in health.channels if count.key == key), ChannelCount(key=key))


def _hearer(service: str, count: ChannelCount) -> Hearer:
    return Hearer(
        service=service,
        wait_median_s=count.wait_median_s,
        wait_max_s=count.wait_max_s,
        num_waiting=count.num_waiting,
        num_dropped=count.num_dropped,
        num_missed=count.num_missed,
    )
