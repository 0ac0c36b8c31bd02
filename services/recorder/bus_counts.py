"""What was published and did not come: by the numbers of what came, and by what the publishers' heartbeats tell."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from shared.messaging.channels import EVENTS, PREFIX
from shared.messaging.messages import ChannelCount, Health, Measurement, Message
from shared.messaging.sequence import SequenceCounter
from shared.runtime.health import source_of

_MAX_PUBLISHERS = 10_000
"""Far more than there are: whoever invents further ones is not followed."""


@dataclass(slots=True)
class _Publisher:
    """told_seq: the last number its heartbeat says it sent. num_lost: by a publisher that was started again since."""

    counter: SequenceCounter = field(default_factory=SequenceCounter)
    told_seq: int | None = None
    num_lost: int = 0

    @property
    def num_outstanding(self) -> int:
        """Sent, as told, and not received."""
        last_seq = self.counter.last_seq
        is_behind = self.told_seq is not None and last_seq is not None and self.told_seq > last_seq
        return self.num_lost + (self.told_seq - last_seq if is_behind else 0)  # type: ignore[operator]

    def take(self, seq: int) -> int:
        if self.counter.is_late(seq):
            return self.counter.add(seq)
        if self.counter.num_received == 0 and self.told_seq is not None and seq <= self.told_seq:
            self.counter.last_seq = None  # a heartbeat told of it before it came
        last_seq = self.counter.last_seq
        if last_seq is not None and seq <= last_seq:  # started again: what was outstanding is lost
            self.num_lost, self.told_seq = self.num_outstanding, None
        num_lost, self.num_lost = self.num_lost, 0
        return num_lost + self.counter.add(seq)

    def tell(self, seq: int) -> None:
        if self.counter.last_seq is None:
            self.counter.last_seq = seq
        if self.told_seq is not None and seq < self.told_seq:  # started again, and nothing of it has come yet
            self.num_lost, self.counter.last_seq = self.num_outstanding, -1
        self.told_seq = seq

    def settle(self) -> None:
        if self.counter.last_seq is not None and self.told_seq is not None:
            self.counter.last_seq = max(self.counter.last_seq, self.told_seq)
        self.num_lost = 0


class BusCounts:
    """Follows every publisher of every key. Its messages and its heartbeats come in the order it sent them.

    What was sent before a publisher was first heard of is not counted. Commands have no numbers and are not followed.
    """

    def __init__(self) -> None:
        self._publishers: dict[tuple[str, str], _Publisher] = {}

    def received(self, key: str, message: Message) -> int:
        """Notes a message that came; returns how many of its publisher's were lost just before it."""
        if not isinstance(message, Measurement):
            return 0
        return self.took(key, source_of(message), message.seq)

    def took(self, key: str, source: str, seq: int) -> int:
        """The same of a message by its number, and who numbers it: "" where only one publisher does."""
        return self._of(key, source).take(seq)

    def heard(self, health: Health) -> None:
        """Notes what a service says that it sent."""
        for count in health.channels:
            if count.num_sent and count.last_seq is not None:
                key = count.key.removeprefix(PREFIX)
                is_shared = key == EVENTS.key
                self._of(key, health.service if is_shared else "").tell(_last_sent(count, is_shared=is_shared))

    def outstanding(self) -> Counter[str]:
        """By key: what was sent, as far as is known, and has not come."""
        outstanding: Counter[str] = Counter()
        for (key, _), publisher in self._publishers.items():
            outstanding[key] += publisher.num_outstanding
        return +outstanding

    def settle(self) -> None:
        """Forgets what is outstanding: it was lost before the recording that begins now."""
        for publisher in self._publishers.values():
            publisher.settle()

    def _of(self, key: str, source: str) -> _Publisher:
        if (key, source) not in self._publishers and len(self._publishers) >= _MAX_PUBLISHERS:
            return _Publisher()
        return self._publishers.setdefault((key, source), _Publisher())


def _last_sent(count: ChannelCount, *, is_shared: bool) -> int:
    """Who also hears a key that it sends on has the last number heard in `last_seq`; events count from 0 by one."""
    assert count.last_seq is not None
    return count.num_sent - 1 if is_shared else count.last_seq
