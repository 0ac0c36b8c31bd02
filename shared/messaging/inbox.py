"""Where Zenoh's threads leave bytes for a service's one loop: bounded, ordered by arrival, losses counted."""

from __future__ import annotations

import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, replace

from shared.messaging.channels import PREFIX, Channel, Delivery
from shared.messaging.fields import MAX_NAME_CHARS

LATEST_DEPTH = 2
EVERY_DEPTH = 1000
MAX_BYTES = 256 * 1024 * 1024
"""Of all that waits: as much as the largest message has."""
PARCEL_BYTES = 500
"""What a parcel takes beside its payload, at most, or nothing in it would be nothing."""
MAX_KEYS = 1000
"""That are told apart; whoever invents more of them, or longer ones than any name, is counted as one."""
OTHER_KEYS = PREFIX + "**"


@dataclass(frozen=True, slots=True)
class Parcel:
    """Bytes that came for a channel, not yet decoded.

    key: the concrete key expression. received_ns: monotonic time. is_replay: an answer to our own query for the last
    message, which may also come, or have come, by itself. reply: where a query wants its answer (accepted, text).
    """

    channel: Channel
    key: str
    payload: bytes
    schema: str | None
    received_ns: int
    is_replay: bool = False
    reply: Callable[[bool, str], None] | None = None


class Inbox:
    """LATEST channels keep the newest `LATEST_DEPTH` parcels, others up to `EVERY_DEPTH`; all together `MAX_BYTES`.

    max_bytes: lossless then: every parcel of every channel is kept as long as all together have no more bytes.
    `num_dropped` counts, by key, what had to go: superseded by newer (LATEST) or refused because full (EVERY). A parcel
    of a key beyond `MAX_KEYS` gets the key `OTHER_KEYS`.
    """

    def __init__(self, *, max_bytes: int | None = None) -> None:
        self.num_dropped: Counter[str] = Counter()
        self._is_lossless = max_bytes is not None
        self._bytes_left = MAX_BYTES if max_bytes is None else max_bytes
        self._arrivals: deque[Parcel] = deque()
        self._pending: Counter[str] = Counter()
        self._keys: set[str] = set()
        self._changed = threading.Condition()

    def put(self, parcel: Parcel) -> bool:
        """Takes a parcel, or returns False where it is full. Called on Zenoh's threads; never waits for the service."""
        with self._changed:
            parcel = self._told_apart(parcel)
            if not self._make_room(parcel):
                self.num_dropped[parcel.key] += 1
                return False
            self._arrivals.append(parcel)
            self._pending[parcel.key] += 1
            self._bytes_left -= _size(parcel)
            self._changed.notify()
            return True

    def take(self, timeout_s: float) -> Parcel | None:
        """The oldest parcel, waiting for one at most `timeout_s`; None if none came."""
        deadline = time.monotonic() + timeout_s
        with self._changed:
            while not self._arrivals:
                remaining = deadline - time.monotonic()
                if remaining <= 0 or not self._changed.wait(remaining):
                    return None
            parcel = self._arrivals.popleft()
            self._forget(parcel)
            return parcel

    def num_waiting(self) -> dict[str, int]:
        """How many parcels of each key wait now."""
        with self._changed:
            return {key: num for key, num in self._pending.items() if num}

    def _told_apart(self, parcel: Parcel) -> Parcel:
        if parcel.key not in self._keys:
            if len(self._keys) >= MAX_KEYS or len(parcel.key) > MAX_NAME_CHARS:
                return replace(parcel, key=OTHER_KEYS)
            self._keys.add(parcel.key)
        return parcel

    def _make_room(self, parcel: Parcel) -> bool:
        if not self._is_lossless and self._pending[parcel.key] >= self._depth(parcel):
            if self._depth(parcel) == EVERY_DEPTH:
                return False
            oldest = next(waiting for waiting in self._arrivals if waiting.key == parcel.key)
            self._arrivals.remove(oldest)
            self._forget(oldest)
            self.num_dropped[parcel.key] += 1
        return _size(parcel) <= self._bytes_left

    @staticmethod
    def _depth(parcel: Parcel) -> int:
        is_every = parcel.channel.delivery is Delivery.EVERY or parcel.is_replay
        return EVERY_DEPTH if is_every else LATEST_DEPTH

    def _forget(self, parcel: Parcel) -> None:
        self._pending[parcel.key] -= 1
        self._bytes_left += _size(parcel)


def _size(parcel: Parcel) -> int:
    return PARCEL_BYTES + len(parcel.payload)
