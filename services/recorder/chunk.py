"""One chunk of an MCAP file: messages side by side, compressed as one.

The writer of the mcap package cannot leave out a chunk that the disk refused, and then write a true index.
Source: https://mcap.dev/spec#chunk-op0x06.
"""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from collections.abc import Callable
from typing import Literal

import lz4.frame
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import ChunkIndex, McapRecord, MessageIndex

from services.recorder.records import Record

Compression = Literal["lz4", "zstd", "none"]

_COMPRESS: dict[str, Callable[[bytes], bytes]] = {
    "lz4": lz4.frame.compress,
    "zstd": zstandard.compress,
    "none": lambda data: data,
}
_MESSAGE_HEAD = struct.Struct("<BQHIQQ")
"""Opcode, length of the rest; channel, sequence, log time, publish time."""
_CHUNK_HEAD = struct.Struct("<BQQQQI")
"""Opcode, length of the rest; start time, end time, uncompressed size, its CRC."""
_LENGTH_BYTES = 9
"""Of an opcode and a length, which the length does not count."""


class Chunk:
    """Declarations of schemas and channels, then messages, in the order in which they are added."""

    def __init__(self) -> None:
        self.num_bytes = 0
        self.num_messages: Counter[int] = Counter()
        self.num_new: Counter[str] = Counter()
        self.start_ns = 0
        self.end_ns = 0
        self._parts: list[bytes | memoryview] = []
        self._places: dict[int, list[tuple[int, int]]] = {}

    def declare(self, record: McapRecord) -> None:
        """Adds a schema or a channel, before the first message that needs it."""
        builder = RecordBuilder()
        record.write(builder)
        self._append(builder.end())  # type: ignore[no-untyped-call]

    def add(self, channel_id: int, record: Record) -> None:
        """Adds a message of a declared channel."""
        self.start_ns = min(self.start_ns, record.log_ns) if self.num_messages else record.log_ns
        self.end_ns = max(self.end_ns, record.log_ns)
        self.num_messages[channel_id] += 1
        self.num_new[record.channel.key] += not record.is_repeated
        self._places.setdefault(channel_id, []).append((record.log_ns, self.num_bytes))
        head = _MESSAGE_HEAD.pack(
            Opcode.MESSAGE,
            _MESSAGE_HEAD.size - _LENGTH_BYTES + len(record.data),
            channel_id,
            record.sequence,
            record.log_ns,
            record.stamp_ns,
        )
        self._append(head)
        self._append(record.data)

    def encoded(self, compression: Compression, offset: int) -> tuple[list[bytes], ChunkIndex]:
        """The chunk's bytes and its message indexes' as they stand in the file from `offset` on, and its index."""
        plain = b"".join(self._parts)
        data = _COMPRESS[compression](plain)
        name = b"" if compression == "none" else compression.encode()
        tail = struct.pack("<I", len(name)) + name + struct.pack("<Q", len(data))
        length = _CHUNK_HEAD.size - _LENGTH_BYTES + len(tail) + len(data)
        head = _CHUNK_HEAD.pack(Opcode.CHUNK, length, self.start_ns, self.end_ns, len(plain), zlib.crc32(plain)) + tail
        chunk_length = length + _LENGTH_BYTES
        indexes = RecordBuilder()
        offsets = {}
        for channel_id, places in self._places.items():
            offsets[channel_id] = offset + chunk_length + indexes.count
            MessageIndex(channel_id=channel_id, records=places).write(indexes)
        index = ChunkIndex(
            chunk_length=chunk_length,
            chunk_start_offset=offset,
            compression=name.decode(),
            compressed_size=len(data),
            message_end_time=self.end_ns,
            message_index_length=indexes.count,
            message_index_offsets=offsets,
            message_start_time=self.start_ns,
            uncompressed_size=len(plain),
        )
        return [head, data, indexes.end()], index  # type: ignore[no-untyped-call]

    def _append(self, part: bytes | memoryview) -> None:
        self._parts.append(part)
        self.num_bytes += len(part)
