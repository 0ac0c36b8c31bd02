"""Takes the records out of a chunk of an MCAP file. A chunk says how large it is when decompressed: no more is made.

The mcap package decompresses whatever is there. Source: https://mcap.dev/spec#chunk-op0x06.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Callable, Iterator
from io import BytesIO
from typing import IO

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, InvalidMagic, McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Header, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import CRCValidationError

MAGIC = b"\x89MCAP0\r\n"
_HEAD = struct.Struct("<BQ")
"""Of every record: what it is, and how many bytes follow."""
HEAD_BYTES = _HEAD.size
_KINDS: dict[int, Callable[[ReadDataStream], McapRecord]] = {
    Opcode.HEADER: Header.read,
    Opcode.SCHEMA: Schema.read,
    Opcode.CHANNEL: Channel.read,
    Opcode.METADATA: Metadata.read,
}
"""What is given besides messages and the records of chunks."""
MAX_CHUNK_BYTES = 1024**3
"""Decompressed. Recorders close a chunk after a few MiB."""

BROKEN = (
    McapError,
    zstandard.ZstdError,
    ValueError,
    OverflowError,
    RuntimeError,
    MemoryError,
    LookupError,
    struct.error,
)
"""What the libraries raise on bytes that are not what they should be."""


class ChunkError(McapError):
    """A chunk that is not what its head says."""


def records_of(chunk: Chunk) -> list[McapRecord]:
    """Schemas, channels and messages of a chunk whose checksum, if it has one, is right.

    Raises:
        ChunkError: its head lies, or it is larger than `MAX_CHUNK_BYTES`. Others of `BROKEN`: its bytes are.
    """
    data = _decompressed(chunk)
    if len(data) != chunk.uncompressed_size:
        raise ChunkError(f"a chunk says it has {chunk.uncompressed_size} bytes, and has another number")
    if chunk.uncompressed_crc and (crc := zlib.crc32(data)) != chunk.uncompressed_crc:
        raise CRCValidationError(expected=chunk.uncompressed_crc, actual=crc, record=chunk)
    stream = ReadDataStream(BytesIO(data))
    records: list[McapRecord] = []
    while stream.count < len(data):
        opcode, num_bytes = stream.read1(), stream.read8()
        if num_bytes > len(data) - stream.count:
            raise ChunkError(f"a record of {num_bytes} bytes is longer than its chunk")
        if opcode == Opcode.CHANNEL:
            records.append(Channel.read(stream))
        elif opcode == Opcode.MESSAGE:
            records.append(Message.read(stream, num_bytes))
        elif opcode == Opcode.SCHEMA:
            records.append(Schema.read(stream))
        else:
            stream.read(num_bytes)
    return records


def file_records(file: IO[bytes]) -> Iterator[McapRecord]:
    """The records of an open file from its begin to its summary; those of a chunk once all of it is there.

    Raises:
        What is in `BROKEN`: the file is none, is cut off or broken.
    """
    file.seek(0)
    magic = file.read(len(MAGIC))
    if len(magic) < len(MAGIC):
        raise EndOfFile
    if magic != MAGIC:
        raise InvalidMagic(magic)
    opcode = Opcode.HEADER
    while opcode != Opcode.DATA_END:
        opcode, num_bytes = _HEAD.unpack(file.read(_HEAD.size))
        if num_bytes > size_of(file) - file.tell():
            file.seek(0, os.SEEK_END)
            raise EndOfFile
        content = file.read(num_bytes)
        if opcode == Opcode.CHUNK:
            yield from records_of(chunk_of(content))
        elif opcode == Opcode.MESSAGE:
            yield Message.read(ReadDataStream(BytesIO(content)), num_bytes)
        elif (read := _KINDS.get(opcode)) is not None:
            yield read(ReadDataStream(BytesIO(content)))


def chunk_of(content: bytes) -> Chunk:
    """The chunk of a record's content, what follows its length; what it raises is in `BROKEN`."""
    chunk: Chunk = Chunk.read(ReadDataStream(BytesIO(content)))
    return chunk


def size_of(file: IO[bytes]) -> int:
    """Bytes of an open file: no record of it can be longer."""
    return os.fstat(file.fileno()).st_size


def _decompressed(chunk: Chunk) -> bytes:
    """At most one byte more than the chunk says it has."""
    if chunk.uncompressed_size > MAX_CHUNK_BYTES:
        raise ChunkError(f"a chunk of {chunk.uncompressed_size} bytes, at most {MAX_CHUNK_BYTES} are read")
    limit = chunk.uncompressed_size + 1
    match chunk.compression:
        case "":
            return bytes(chunk.data)
        case "lz4":
            data: bytes = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=limit)
            return data
        case "zstd":
            with zstandard.ZstdDecompressor().stream_reader(chunk.data) as reader:
                return reader.read(limit)
    raise ChunkError(f"compression '{chunk.compression[:20]}' is unknown")
