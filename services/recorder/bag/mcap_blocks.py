"""Reads an MCAP file from its beginning to its end, also one that was cut off or damaged: every whole chunk of it.

A record says its own length, so after a damaged length nothing is where it should be: then the next chunk is searched
for, and believed if its checksum is right. Source: https://mcap.dev/spec
"""

from __future__ import annotations

import mmap
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Footer, Header, McapRecord, Metadata, Schema

from shared.errors import InputFileError
from shared.mcap_chunks import BROKEN, records_of

_MAGIC = b"\x89MCAP0\r\n"
_HEAD = struct.Struct("<BQ")
"""Of every record: what it is, and how many bytes follow."""
_CHUNK = struct.Struct("<QQQII")
"""Of a chunk: first and last time, size and checksum before compression, length of the compression's name."""
_CODECS = (b"", b"lz4", b"zstd")
_FOOTER_CRC_BYTES = 4
_KINDS: dict[int, Callable[[ReadDataStream], McapRecord]] = {
    Opcode.HEADER: Header.read,
    Opcode.FOOTER: Footer.read,
    Opcode.SCHEMA: Schema.read,
    Opcode.CHANNEL: Channel.read,
    Opcode.CHUNK: Chunk.read,
    Opcode.METADATA: Metadata.read,
}
"""What is read; all else is derived from it."""


@dataclass(frozen=True, slots=True)
class Block:
    """What stands in one whole record from `offset` to `end`: a chunk's records, or itself. In its order."""

    offset: int
    end: int
    records: list[McapRecord]


@dataclass(frozen=True, slots=True)
class Damage:
    """Bytes that could not be read. has_data: they held, or may have held, messages."""

    offset: int
    num_bytes: int
    reason: str
    has_data: bool = True

    def __str__(self) -> str:
        return f"{self.reason}: {self.num_bytes} bytes from byte {self.offset} on"


class McapBlocks:
    """One pass over a file. All it says is true of what `blocks` has gone through so far.

    is_complete: the end of the file says that its writer closed it. num_chunks: whole ones.

    Raises:
        InputFileError: there is no such file, or it is empty.
    """

    def __init__(self, path: Path) -> None:
        self.damage: list[Damage] = []
        self.is_complete = False
        self.num_chunks = 0
        self._path = path
        self._is_index = False
        try:
            with path.open("rb") as file:
                self._bytes = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        except (OSError, ValueError) as error:
            reason = error.strerror if isinstance(error, OSError) else "is empty"
            raise InputFileError(f"{path}: {reason}") from error
        self.num_bytes = len(self._bytes)

    def blocks(self) -> Iterator[Block]:
        """Every whole record that tells something.

        Raises:
            InputFileError: the file is no MCAP file: neither its beginning nor anything in it.
        """
        position = believed = len(_MAGIC) if self._bytes[: len(_MAGIC)] == _MAGIC else 0
        while position < self.num_bytes and not self.is_complete:
            end = self._end_of(position)
            block = None if end is None else self._block(position, end)
            if end is None or block is None:
                position = self._search(position, believed)
                continue
            if self._bytes[position] == Opcode.CHUNK and block.records:
                believed = end
                self.num_chunks += 1
            position = end
            yield block
        if believed == 0:
            raise InputFileError(f"{self._path}: is no MCAP file")
        if not self.is_complete and not self.damage:
            self._note(self.num_bytes, self.num_bytes, "cut off")

    def _search(self, position: int, believed: int) -> int:
        """Where to go on after something that is no record; it may be that a wrong length has led here."""
        following = self._next_chunk(max(believed, 1))
        if self._is_index or following == self.num_bytes:
            self._note(position, self.num_bytes, "cut off")
            return self.num_bytes
        self._note(min(position, following), following, "damaged")
        return following

    def _note(self, begin: int, end: int, reason: str) -> None:
        what = "the index is " if self._is_index else ""
        self.damage.append(Damage(begin, end - begin, what + reason, has_data=not self._is_index))

    def _end_of(self, position: int) -> int | None:
        """The end of the record that begins here, or None where none can: judged by its head alone."""
        begin = position + _HEAD.size
        if begin > self.num_bytes:
            return None
        opcode, num_bytes = _HEAD.unpack_from(self._bytes, position)
        end = begin + int(num_bytes)
        is_record = Opcode.HEADER <= opcode <= Opcode.DATA_END and end <= self.num_bytes
        if not is_record or (opcode == Opcode.CHUNK and not self._is_chunk(begin, end)):
            return None
        return end

    def _is_chunk(self, begin: int, end: int) -> bool:
        """Whether the lengths within a chunk agree with its own."""
        name = begin + _CHUNK.size
        if name > end:
            return False
        start_ns, end_ns, _, _, num_name = _CHUNK.unpack_from(self._bytes, begin)
        size = name + num_name
        if num_name > len(_CODECS[-1]) or self._bytes[name:size] not in _CODECS or size + 8 > end:
            return False
        (num_records,) = struct.unpack_from("<Q", self._bytes, size)
        return bool(start_ns <= end_ns and size + 8 + num_records == end)

    def _block(self, position: int, end: int) -> Block | None:
        """None where the content is not what the head promises; of a chunk with a wrong checksum nothing is given."""
        opcode = self._bytes[position]
        self._is_index |= opcode == Opcode.DATA_END
        read = _KINDS.get(opcode)
        if read is None:
            return Block(position, end, [])
        content = BytesIO(self._bytes[position + _HEAD.size : end])
        try:
            record = read(ReadDataStream(content))
        except BROKEN:
            return None
        if isinstance(record, Chunk):
            return Block(position, end, self._records_of(record, position, end))
        if isinstance(record, Footer):
            self._finish(record, position, end)
        return Block(position, end, [record])

    def _records_of(self, chunk: Chunk, position: int, end: int) -> list[McapRecord]:
        try:
            return records_of(chunk)
        except BROKEN:
            self._note(position, end, "a chunk is damaged")
            return []

    def _finish(self, footer: Footer, position: int, end: int) -> None:
        self.is_complete = self._bytes[end:] == _MAGIC
        if not self.is_complete:
            return
        summary = self._bytes[footer.summary_start : end - _FOOTER_CRC_BYTES] if footer.summary_start else b""
        if footer.summary_crc and zlib.crc32(summary) != footer.summary_crc:
            self._note(footer.summary_start, position, "damaged")

    def _next_chunk(self, begin: int) -> int:
        """Where the next chunk with a right checksum begins; the end of the file if none does."""
        opcode = bytes([Opcode.CHUNK])
        position = self._bytes.find(opcode, begin)
        while position >= 0:
            end = self._end_of(position)
            if end is not None and self._is_whole(position, end):
                return position
            position = self._bytes.find(opcode, position + 1)
        return self.num_bytes

    def _is_whole(self, position: int, end: int) -> bool:
        try:
            chunk = Chunk.read(ReadDataStream(BytesIO(self._bytes[position + _HEAD.size : end])))
            return chunk.uncompressed_crc != 0 and bool(records_of(chunk))
        except BROKEN:
            return False
