"""Shared memory for large payloads: one copy instead of a way through two sockets."""

from __future__ import annotations

import threading
from typing import IO

import structlog
import zenoh

from shared.messaging.queues import BATCH_BYTES
from shared.runtime.shared_memory import empty_abandoned, mapped_segments, own

log = structlog.get_logger()


class Pool:
    """A session's own segment of shared memory, made for the first payload that is too large for a batch.

    size_bytes: 0 = none. Readers copy what they get at once, so that it is free again soon.
    """

    def __init__(self, size_bytes: int) -> None:
        self._size_bytes = size_bytes
        self._provider: zenoh.shm.ShmProvider | None = None
        self._mark: IO[bytes] | None = None
        self._lock = threading.Lock()

    def place(self, payload: bytes) -> zenoh.shm.ZShmMut | bytes:
        """The payload in shared memory if it is large and there is room, or as it is."""
        if len(payload) <= BATCH_BYTES or not self._size_bytes:
            return payload
        with self._lock:
            if self._provider is None:
                self._make()
            if self._provider is None:
                return payload
            try:
                buffer = self._provider.alloc(len(payload), policy=zenoh.shm.GarbageCollect())
            except zenoh.ZError:  # full of what readers have not read yet
                return payload
        buffer[:] = payload
        return buffer

    def close(self) -> None:
        """The segment may be emptied from now on. Idempotent."""
        self._provider = None
        if self._mark is not None:
            self._mark.close()

    def _make(self) -> None:
        empty_abandoned()
        before = mapped_segments()
        try:
            self._provider = zenoh.shm.ShmProvider.default_backend(self._size_bytes)
        except zenoh.ZError as error:
            log.warning("no shared memory for large messages, they go through the socket", reason=str(error))
            self._size_bytes = 0
            return
        made = [path for path in mapped_segments() - before if path.stat().st_size == self._size_bytes]
        if len(made) == 1:  # or a reader's thread has mapped another's meanwhile, and nobody can say which is ours
            self._mark = own(made[0])
