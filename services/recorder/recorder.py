"""The recorder's facade: one recording of whatever it is given, stamped with simulated time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from services.recorder.mcap_log import McapLog
from shared.messaging.channels import CHANNELS, Channel
from shared.messaging.messages import Health, Measurement, Message
from shared.runtime.config import RecorderConfig


class Recorder:
    """Writes messages to `path`. A command, which carries no stamp, is logged at the newest simulated time seen.

    metadata: text kept at the head of the file. channels: the table, with those of further sensors.
    """

    def __init__(
        self, config: RecorderConfig, path: Path, metadata: Mapping[str, str], channels: Iterable[Channel] = CHANNELS
    ) -> None:
        self._log = McapLog(
            path, channels, metadata, chunk_bytes=config.chunk_size_kib * 1024, compression=config.compression
        )
        self._stamp_ns = 0

    def add(self, channel: Channel, message: Message) -> list[Message]:
        """Records one message.

        Raises:
            RecordingError: the disk refuses.
        """
        if isinstance(message, Measurement):
            self._stamp_ns = message.stamp_ns
        concrete = channel.of(message.service) if isinstance(message, Health) else channel
        self._log.write(concrete, message, self._stamp_ns)
        return []

    def flush(self) -> list[Message]:
        """Closes the open chunk: what came so far survives a kill from now on."""
        self._log.flush()
        return []

    def close(self) -> list[Message]:
        """Completes the file with index and counts. Idempotent."""
        self._log.close()
        return []
