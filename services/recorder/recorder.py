"""The recorder's facade: one recording of whatever it is given, stamped with simulated time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

from services.recorder.mcap_log import McapLog
from shared.messaging.channels import CHANNELS, Channel
from shared.messaging.messages import Event, Health, Measurement, Message
from shared.runtime.config import RecorderConfig

_MAX_EARLY = 1000


class Recorder:
    """Writes messages to `path`. What has no time of its own is logged at the newest time seen: a command, and what a
    service says that has seen no time yet. Before any time is known such messages wait, up to a thousand of them, or a
    recording of a real sensor, whose time is that of day, would begin in 1970.

    metadata: text kept at the head of the file. channels: the table, with those of further sensors.
    """

    def __init__(
        self, config: RecorderConfig, path: Path, metadata: Mapping[str, str], channels: Iterable[Channel] = CHANNELS
    ) -> None:
        self._log = McapLog(
            path, channels, metadata, chunk_bytes=config.chunk_size_kib * 1024, compression=config.compression
        )
        self._stamp_ns: int | None = None
        self._waiting: list[tuple[Channel, Message]] = []

    def add(self, channel: Channel, message: Message) -> list[Message]:
        """Records one message.

        Raises:
            RecordingError: the disk refuses.
        """
        concrete = channel.of(message.service) if isinstance(message, Health) else channel
        stamp_ns = _time_of(message)
        self._stamp_ns = self._stamp_ns if stamp_ns is None else stamp_ns
        self._waiting.append((concrete, message))
        if self._stamp_ns is not None or len(self._waiting) > _MAX_EARLY:
            self._write_waiting(self._stamp_ns or 0)
        return []

    def flush(self) -> list[Message]:
        """Closes the open chunk: what came so far survives a kill from now on."""
        self._log.flush()
        return []

    def close(self) -> list[Message]:
        """Completes the file with index and counts. Idempotent."""
        if self._log.is_open:
            self._write_waiting(self._stamp_ns or 0)
        self._log.close()
        return []

    def _write_waiting(self, stamp_ns: int) -> None:
        waiting, self._waiting = self._waiting, []
        for channel, message in waiting:
            self._write(channel, message, stamp_ns)

    def _write(self, channel: Channel, message: Message, stamp_ns: int) -> None:
        if isinstance(message, Measurement) and _time_of(message) is None:
            message = replace(message, stamp_ns=stamp_ns)
        self._log.write(channel, message, stamp_ns)


def _time_of(message: Message) -> int | None:
    """None: a command, or what a service says that has seen no time yet."""
    if not isinstance(message, Measurement) or (isinstance(message, Health | Event) and message.stamp_ns == 0):
        return None
    return message.stamp_ns
