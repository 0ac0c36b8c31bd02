"""Writes records into one MCAP file, so that whatever was closed in a chunk survives the death of the writer.

MCAP: https://mcap.dev/spec. Profile `ros2`, message encoding `cdr`, schema encoding `ros2msg`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping

from mcap import records as mcap
from mcap.data_stream import RecordBuilder

from services.recorder.chunk import Chunk, Compression
from services.recorder.disk import Output, RecordingError
from services.recorder.mcap_summary import MAGIC, Summary
from services.recorder.records import Record
from services.recorder.ros.schemas import schema_text
from shared.messaging.channels import Channel

CHUNK_BYTES = 1024 * 1024
"""A chunk closes at this size: MCAP's usual one, a compromise between compression and what a reader must load."""

_LIBRARY = "hyrecro"


class McapLog:
    """One file. Not for several threads. `close` it in the end: only then has it its index.

    num_written: by key, records in whole chunks; repeated ones are not counted.
    """

    def __init__(
        self,
        output: Output,
        channels: Iterable[Channel],
        metadata: Mapping[str, Mapping[str, str]],
        *,
        chunk_bytes: int = CHUNK_BYTES,
        compression: Compression = "lz4",
        check_room: Callable[[int], None] = lambda num_bytes: None,
    ) -> None:
        """Begins a file.

        output: empty; closed with the log. channels: those declared also if nothing comes on them, but for keys with
        `*`. metadata: name -> text, stored at the head. check_room: raises RecordingError if a chunk shall not be
        written.

        Raises:
            RecordingError: the disk refuses.
            ValueError: two channels claim one topic with different ROS types.
        """
        self.num_written: Counter[str] = Counter()
        self._output = output
        self._chunk_bytes, self._compression, self._check_room = chunk_bytes, compression, check_room
        self._summary = Summary()
        self._schemas: dict[str, mcap.Schema] = {}
        self._channels: dict[str, tuple[mcap.Channel, str]] = {}
        self._undeclared: list[mcap.Schema | mcap.Channel] = []
        self._chunk = Chunk()
        self._is_broken = self._is_closed = False
        try:
            self._output.write(MAGIC + _bytes_of(mcap.Header(profile="ros2", library=_LIBRARY)))
            self._add_metadata(metadata)
            self._output.mark_complete()
        except OSError as error:
            broken = self._broken(error)
            self._output.close()
            raise broken from error
        for channel in channels:
            if channel.is_recorded and "*" not in channel.topic:
                self._declare(channel)

    @property
    def num_bytes(self) -> int:
        """Size of the file."""
        return self._output.position

    def add(self, record: Record) -> None:
        """Adds a record to the open chunk, and closes it when it is large enough.

        Raises:
            RecordingError: the disk refuses, now or before. The open chunk is lost.
            ValueError: the channel's topic stands in the file with another ROS type.
        """
        if self._is_broken or self._is_closed:
            raise RecordingError("the recording is closed")
        channel_id = self._declare(record.channel)
        if self._undeclared:
            for declaration in self._undeclared:
                self._chunk.declare(declaration)
            self._undeclared.clear()
        self._chunk.add(channel_id, record)
        if self._chunk.num_bytes >= self._chunk_bytes:
            self.flush()

    def flush(self) -> None:
        """Closes the open chunk, if it holds messages, and hands it to the operating system.

        Called on a timer, it bounds what a killed process can lose. A power cut may lose more: nothing is synced.

        Raises:
            RecordingError: the disk refuses. The chunk is lost.
        """
        if not self._chunk.num_messages:
            return
        chunk, self._chunk = self._chunk, Chunk()
        try:
            parts, index = chunk.encoded(self._compression, self._output.position)
            self._check_room(sum(map(len, parts)))
            for part in parts:
                self._output.write(part)
            self._output.mark_complete()
        except (OSError, RecordingError) as error:
            raise self._broken(error) from error
        self._summary.chunks.append(index)
        self._summary.num_messages.update(chunk.num_messages)
        self.num_written.update(chunk.num_new)

    def close(self, metadata: Mapping[str, Mapping[str, str]] | None = None) -> None:
        """Writes further metadata and the index, also after a failure, and closes the file. Again: does nothing.

        The caller flushes first. Raises:
            RecordingError: the disk refuses; the whole chunks stay readable.
        """
        if self._is_closed:
            return
        self._is_closed = True
        try:
            if not self._is_broken:
                self._output.write(b"".join(map(_bytes_of, self._undeclared)))
            self._add_metadata(metadata or {})
            self._output.write(self._complete_summary().encoded(self._output.position))
            self._output.mark_complete()
        except OSError as error:
            raise self._broken(error) from error
        finally:
            self._output.close()

    def _add_metadata(self, metadata: Mapping[str, Mapping[str, str]]) -> None:
        for name, entries in metadata.items():
            data = _bytes_of(mcap.Metadata(name=name, metadata=dict(entries)))
            self._summary.metadata.append(mcap.MetadataIndex(self._output.position, len(data), name))
            self._output.write(data)

    def _declare(self, channel: Channel) -> int:
        known = self._channels.get(channel.topic)
        if known is None:
            known = self._register(channel), channel.ros_type
            self._channels[channel.topic] = known
        if known[1] != channel.ros_type:
            raise ValueError(f"{channel.topic} is recorded as {known[1]}, not as {channel.ros_type}")
        return known[0].id

    def _register(self, channel: Channel) -> mcap.Channel:
        ros_type = channel.ros_type
        if ros_type not in self._schemas:
            text = schema_text(ros_type).encode()
            schema = mcap.Schema(id=len(self._schemas) + 1, name=ros_type, encoding="ros2msg", data=text)
            self._schemas[ros_type] = schema
            self._undeclared.append(schema)
        declared = mcap.Channel(
            id=len(self._channels) + 1,
            topic=channel.topic,
            message_encoding="cdr",
            metadata={},
            schema_id=self._schemas[ros_type].id,
        )
        self._undeclared.append(declared)
        return declared

    def _complete_summary(self) -> Summary:
        """With every schema and channel; those of a chunk that was lost do no harm."""
        self._summary.schemas = list(self._schemas.values())
        self._summary.channels = [channel for channel, _ in self._channels.values()]
        return self._summary

    def _broken(self, error: OSError | RecordingError) -> RecordingError:
        """Takes no more records after this; a half-written chunk is cut off, if the disk lets it."""
        self._is_broken = True
        self._output.cut()
        if isinstance(error, RecordingError):
            return error
        return RecordingError(f"the recording ended after {self._output.num_complete_bytes} bytes: {error.strerror}")


def _bytes_of(record: mcap.McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data
