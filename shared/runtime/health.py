"""What a service counts of its own traffic, and the heartbeat made of it."""

from __future__ import annotations

import statistics
from collections.abc import Mapping
from dataclasses import dataclass, field

from shared.messaging.messages import ChannelCount, Event, Measurement, Message
from shared.messaging.sequence import SequenceCounter
from shared.messaging.values import MAX_COUNT

MAX_SOURCES = 1000
"""Publishers of one key whose numbers are followed."""


@dataclass(slots=True)
class KeyTraffic:
    """Counters of one key. `sources` follows each publisher's `seq`: many may share a key such as `events`.

    waits_s: how long each message taken since the last snapshot had waited.
    """

    num_sent: int = 0
    num_bytes_sent: int = 0
    num_received: int = 0
    num_refused: int = 0
    last_seq: int | None = None
    sources: dict[str, SequenceCounter] = field(default_factory=dict)
    waits_s: list[float] = field(default_factory=list)

    def num_missed(self, num_dropped: int) -> int:
        """By the gaps in `seq`, without those that the inbox made."""
        num_missed = sum(counter.num_missed for counter in self.sources.values()) - num_dropped
        return min(max(0, num_missed), MAX_COUNT)


class Traffic:
    """Counts by key; knows the newest simulated time seen. Pure: told of every message, asked for a snapshot.

    The inbox sees to it that keys are not without end.
    """

    def __init__(self) -> None:
        self.stamp_ns = 0
        self._keys: dict[str, KeyTraffic] = {}
        self._replayed: dict[str, tuple[int, int]] = {}

    def sent(self, key: str, *, seq: int | None, stamp_ns: int | None, num_bytes: int = 0) -> None:
        """Notes a published message; commands have neither number nor stamp."""
        traffic = self._of(key)
        traffic.num_sent += 1
        traffic.num_bytes_sent += num_bytes
        traffic.last_seq = seq
        self.stamp_ns = self.stamp_ns if stamp_ns is None else stamp_ns

    def received(self, key: str, message: Message, *, tells_time: bool = True) -> None:
        """Notes a decoded message. tells_time: whether its stamp is of our own time."""
        traffic = self._of(key)
        traffic.num_received += 1
        if isinstance(message, Measurement):
            traffic.last_seq = message.seq
            self.stamp_ns = message.stamp_ns if tells_time else self.stamp_ns
            source = source_of(message)
            if source in traffic.sources or len(traffic.sources) < MAX_SOURCES:
                traffic.sources.setdefault(source, SequenceCounter()).add(message.seq)

    def waited(self, key: str, wait_s: float) -> None:
        """Notes how long a message lay in the inbox."""
        self._of(key).waits_s.append(wait_s)

    def refused(self, key: str, *, is_message: bool = False) -> None:
        """Notes bytes that were no message, or a message that was received and then refused: it counts as refused."""
        traffic = self._of(key)
        traffic.num_refused += 1
        traffic.num_received -= is_message

    def is_known(self, key: str, message: Message, *, is_replay: bool) -> bool:
        """Whether a message that was asked for has already come by itself, or the other way round.

        So is what was sent before the one that was asked for, and comes after it: the answer has overtaken it.
        """
        if not isinstance(message, Measurement):
            return False
        now = message.seq, message.stamp_ns
        if not is_replay:
            asked = self._replayed.get(key)
            if asked is not None and message.seq >= asked[0]:
                del self._replayed[key]
            return asked is not None and (now == asked or (message.seq < asked[0] and message.stamp_ns < asked[1]))
        traffic = self._keys.get(key)
        counter = traffic.sources.get(source_of(message)) if traffic is not None else None
        if counter is not None and counter.last_seq is not None and message.seq <= counter.last_seq:
            return True
        self._replayed[key] = now
        return False

    def snapshot(
        self, num_dropped: Mapping[str, int], num_lost: Mapping[str, int], num_waiting: Mapping[str, int]
    ) -> tuple[ChannelCount, ...]:
        """The counters by key; what messages waited begins anew.

        num_dropped: what the inbox had to drop, which is taken off the missed ones. num_lost: what was received and
        lost then, which counts as dropped too. num_waiting: what lies in the inbox.
        """
        for key in (*num_dropped, *num_waiting):
            self._of(key)
        return tuple(
            _count(key, traffic, num_dropped.get(key, 0), num_lost.get(key, 0), num_waiting.get(key, 0))
            for key, traffic in sorted(self._keys.items())
        )

    def _of(self, key: str) -> KeyTraffic:
        return self._keys.setdefault(key, KeyTraffic())


def _count(key: str, traffic: KeyTraffic, num_dropped: int, num_lost: int, num_waiting: int) -> ChannelCount:
    waits_s, traffic.waits_s = traffic.waits_s, []
    return ChannelCount(
        key=key,
        num_sent=traffic.num_sent,
        num_bytes_sent=traffic.num_bytes_sent,
        num_received=traffic.num_received,
        num_missed=traffic.num_missed(num_dropped),
        num_dropped=num_dropped + num_lost,
        num_refused=traffic.num_refused,
        last_seq=traffic.last_seq,
        num_waiting=num_waiting,
        wait_median_s=statistics.median(waits_s) if waits_s else None,
        wait_max_s=max(waits_s, default=None),
    )


def source_of(message: Measurement) -> str:
    """Who numbers this message: events of all services share one key."""
    return message.source if isinstance(message, Event) else ""
