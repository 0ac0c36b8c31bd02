"""One MCAP file, also one that was cut off: every whole chunk of it is read."""

from __future__ import annotations

import os
import struct
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import IO

from mcap.exceptions import EndOfFile, InvalidMagic
from mcap.reader import SeekingReader
from mcap.records import Channel, McapRecord, Message, Schema

from services.sensors.sources.bag import RosMessages, readable, ros2_types
from shared.mcap_chunks import file_records, size_of

_MAGIC = b"\x89MCAP0\r\n"
"""At both ends of a whole file."""
_CUT = (EndOfFile, InvalidMagic, struct.error)
"""What the library raises where a file ends too early."""


class McapFile:
    """Reads with one chunk in memory, in the order of the file, which recorders write as messages come.

    Source: https://mcap.dev/spec
    """

    def __init__(self, path: Path) -> None:
        self._path = path

    def topics(self) -> dict[str, str]:
        """Topic -> ROS type, from the index or else from all of the file. Other encodings than ROS 2's are named."""
        with readable(self._path), self._path.open("rb") as file:
            return _indexed_topics(file) or _all_topics(file)

    def messages(self, topics: Collection[str]) -> RosMessages:
        """The messages of these topics."""
        with readable(self._path), self._path.open("rb") as file:
            catalogue = _Catalogue()
            try:
                for record in file_records(file):
                    if isinstance(record, Message):
                        topic, ros_type = catalogue.channels[record.channel_id]
                        if topic in topics:
                            yield topic, ros2_types().deserialize_cdr(record.data, ros_type)
                    else:
                        catalogue.add(record)
            except _CUT:
                return f"it is cut off after {file.tell()} bytes"
        return ""


class _Catalogue:
    """The schemas and channels met so far."""

    def __init__(self) -> None:
        self._schemas: dict[int, str] = {}
        self.channels: dict[int, tuple[str, str]] = {}
        """Number -> topic and type."""

    def add(self, record: McapRecord) -> None:
        if isinstance(record, Schema):
            self._schemas[record.id] = record.name
        elif isinstance(record, Channel):
            name = self._schemas.get(record.schema_id, "no schema")
            encoding = record.message_encoding
            self.channels[record.id] = (record.topic, name if encoding == "cdr" else f"{name} in {encoding}")

    def topics(self, records: Iterable[McapRecord]) -> dict[str, str]:
        for record in records:
            self.add(record)
        return dict(self.channels.values())


def _indexed_topics(file: IO[bytes]) -> dict[str, str]:
    """Those in the summary at the end of the file; none if it has none."""
    if not _has_end(file):
        return {}
    file.seek(0)
    summary = SeekingReader(file, record_size_limit=size_of(file)).get_summary()
    return _Catalogue().topics([*summary.schemas.values(), *summary.channels.values()]) if summary else {}


def _has_end(file: IO[bytes]) -> bool:
    file.seek(-len(_MAGIC), os.SEEK_END)
    return file.read() == _MAGIC


def _all_topics(file: IO[bytes]) -> dict[str, str]:
    catalogue = _Catalogue()
    try:
        return catalogue.topics(file_records(file))
    except _CUT:
        return dict(catalogue.channels.values())
