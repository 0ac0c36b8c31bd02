"""The end of an MCAP file: what it holds and where. Source: https://mcap.dev/spec#summary-section."""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    McapRecord,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

MAGIC = b"\x89MCAP0\r\n"


@dataclass(slots=True)
class Summary:
    """What stands in the file so far."""

    schemas: list[Schema] = field(default_factory=list)
    channels: list[Channel] = field(default_factory=list)
    chunks: list[ChunkIndex] = field(default_factory=list)
    metadata: list[MetadataIndex] = field(default_factory=list)
    num_messages: Counter[int] = field(default_factory=Counter)

    def encoded(self, offset: int) -> bytes:
        """The bytes that end a file whose data end at `offset`."""
        end_of_data = _bytes_of([DataEnd(0)])
        start = offset + len(end_of_data)
        groups: list[tuple[Opcode, Sequence[McapRecord]]] = [
            (Opcode.SCHEMA, self.schemas),
            (Opcode.CHANNEL, self.channels),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, self.chunks),
            (Opcode.METADATA_INDEX, self.metadata),
        ]
        summary, offsets = b"", []
        for opcode, records in groups:
            if group := _bytes_of(records):
                offsets.append(SummaryOffset(opcode, start + len(summary), len(group)))
                summary += group
        offsets_start = start + len(summary)
        summary += _bytes_of(offsets)
        footer_head = struct.pack("<BQQQ", Opcode.FOOTER, 8 + 8 + 4, start, offsets_start)
        footer = Footer(start, offsets_start, zlib.crc32(footer_head, zlib.crc32(summary)))
        return end_of_data + summary + _bytes_of([footer]) + MAGIC

    def _statistics(self) -> Statistics:
        filled = [chunk for chunk in self.chunks if chunk.message_index_offsets]
        return Statistics(
            attachment_count=0,
            channel_count=len(self.channels),
            channel_message_counts=dict(self.num_messages),
            chunk_count=len(self.chunks),
            message_count=self.num_messages.total(),
            message_end_time=max((chunk.message_end_time for chunk in filled), default=0),
            message_start_time=min((chunk.message_start_time for chunk in filled), default=0),
            metadata_count=len(self.metadata),
            schema_count=len(self.schemas),
        )


def _bytes_of(records: Sequence[McapRecord]) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data
