"""Reads a recording from its head on, as it was written: quick, and also where it has no end."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO

from mcap.exceptions import InvalidMagic
from mcap.records import Channel as McapChannel, McapRecord, Message as McapMessage

from services.recorder.ros.reading import from_cdr
from shared.errors import InputFileError, MessageError
from shared.mcap_chunks import BROKEN, MAGIC, file_records
from shared.messaging.channels import CHANNELS, PREFIX, Channel, channel_of_key
from shared.messaging.messages import Message


class FileOrderReading:
    """One pass through a file that may be truncated, or still be written.

    num_bytes: of the file; num_read: of them so far. is_truncated: after the pass, whether its end was missing.
    num_unreadable: by topic, messages that are not what their channel carries now: those of an older version.

    Raises:
        InputFileError: there is no such file, or it is no MCAP file.
    """

    def __init__(self, path: Path) -> None:
        self.num_read = 0
        self.is_truncated = False
        self.num_unreadable: Counter[str] = Counter()
        self.path = path
        try:
            self.num_bytes = path.stat().st_size
            with path.open("rb") as file:
                next(file_records(file))
        except InvalidMagic as error:
            raise InputFileError(f"{path}: is no MCAP file") from error
        except (OSError, *BROKEN) as error:
            raise InputFileError(f"{path}: cannot be read: {_reason(error)}") from error

    def messages(self, is_wanted: Callable[[Channel, int], bool]) -> Iterator[tuple[Channel, Message]]:
        """The wanted messages: of what channels, from what times (ns) is asked before the costly decoding."""
        channels: dict[int, Channel | None] = {}
        with self.path.open("rb") as file:
            for record in self._records(file):
                if isinstance(record, McapChannel):
                    channels[record.id] = _channel_of_topic(record.topic)
                elif isinstance(record, McapMessage):
                    channel = channels.get(record.channel_id)
                    if channel is not None and is_wanted(channel, record.log_time):
                        message = self._decoded(channel, record)
                        if message is not None:
                            yield channel, message

    def _records(self, file: IO[bytes]) -> Iterator[McapRecord]:
        records = file_records(file)
        while True:
            try:
                record = next(records)
            except StopIteration:
                file.seek(-len(MAGIC), os.SEEK_END)
                self.is_truncated = file.read() != MAGIC
                self.num_read = self.num_bytes
                return
            except BROKEN:
                self.is_truncated = True
                return
            self.num_read = file.tell()
            yield record

    def _decoded(self, channel: Channel, record: McapMessage) -> Message | None:
        try:
            return from_cdr(channel, record.data, record.sequence, record.log_time)
        except MessageError:
            self.num_unreadable[channel.topic] += 1
            return None


def _reason(error: Exception) -> str:
    return (error.strerror if isinstance(error, OSError) else None) or "it ends before its first record"


_BY_TOPIC = {channel.topic: channel for channel in CHANNELS}


def _channel_of_topic(topic: str) -> Channel | None:
    return _BY_TOPIC.get(topic) or channel_of_key(PREFIX + topic.removeprefix("/"))
