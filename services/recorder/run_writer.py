"""One run: a queue, bounded by bytes, and a thread that writes what comes out of it: no disk stops the inbox."""

from __future__ import annotations

import threading
import time
from collections import Counter, deque

from services.recorder.records import Record
from services.recorder.rotation import FileSeries
from shared.messaging.channels import Channel

RECORD_BYTES = 600
"""What a record takes beside its data, at most."""


class RunWriter:
    """Takes records without waiting and writes them in their order; counts those for which there is no room.

    num_received, num_missed: by key, of what was put, and of what was lost on the bus before it.
    """

    def __init__(self, series: FileSeries, *, max_queue_bytes: int, chunk_period_s: float) -> None:
        """Starts the thread. chunk_period_s: a chunk is closed at least this often."""
        self.num_received: Counter[str] = Counter()
        self.num_missed: Counter[str] = Counter()
        self.series = series
        self._chunk_period_s = chunk_period_s
        self._bytes_left = max_queue_bytes
        self._queue: deque[Record] = deque()
        self._overflow: dict[Channel, list[int]] = {}
        self._changed = threading.Condition()
        self._deadline_s: float | None = None
        self._thread = threading.Thread(target=self._work, name="run-writer", daemon=True)
        self._thread.start()

    @property
    def failure(self) -> str:
        """Why nothing is written any more; "" while it is."""
        if not (self._thread.is_alive() or self._deadline_s is not None):
            return self.series.failure or "the writing thread has ended"
        return self.series.failure

    def put(self, record: Record) -> None:
        """Lets a record be written, or counts it as lost where the queue is full."""
        key, size = record.channel.key, RECORD_BYTES + len(record.data)
        with self._changed:
            self.num_received[key] += 1
            self.num_missed[key] += record.num_missed
            if size > self._bytes_left:
                lost = self._overflow.setdefault(record.channel, [0, 0])
                lost[0] += 1
                lost[1] += record.num_missed
                return
            self._bytes_left -= size
            self._queue.append(record)
            self._changed.notify()

    def add_missed(self, channel: Channel, num_missed: int) -> None:
        """Counts what was lost on the bus after the last record of a channel."""
        with self._changed:
            self.num_missed[channel.key] += num_missed
            self._overflow.setdefault(channel, [0, 0])[1] += num_missed

    def close(self, max_wait_s: float) -> bool:
        """Writes what is queued and completes the file. What is not written after `max_wait_s` counts as lost.

        Returns False if even then the disk has not answered.
        """
        with self._changed:
            self._deadline_s = time.monotonic() + max_wait_s
            self._changed.notify()
        self._thread.join(2 * max_wait_s)
        return not self._thread.is_alive()

    def _work(self) -> None:
        flush_s = time.monotonic() + self._chunk_period_s
        while True:
            record, overflow = self._take(flush_s)
            for channel, (num_received, num_missed) in overflow.items():
                self.series.add_lost(channel, num_received, num_missed)
            if record is not None:
                self._write(record)
            elif self._deadline_s is not None:
                break
            if time.monotonic() >= flush_s:
                self.series.flush()
                flush_s = time.monotonic() + self._chunk_period_s
        self.series.close()

    def _write(self, record: Record) -> None:
        if self._deadline_s is not None and time.monotonic() > self._deadline_s:
            self.series.add_lost(record.channel, 1, record.num_missed)
        else:
            self.series.add(record)

    def _take(self, until_s: float) -> tuple[Record | None, dict[Channel, list[int]]]:
        """The next record, and the overflow so far. None: none came in time, or none will."""
        with self._changed:
            while not self._queue and self._deadline_s is None:
                remaining_s = until_s - time.monotonic()
                if remaining_s <= 0 or not self._changed.wait(remaining_s):
                    break
            record = self._queue.popleft() if self._queue else None
            self._bytes_left += RECORD_BYTES + len(record.data) if record else 0
            overflow, self._overflow = self._overflow, {}
            return record, overflow
