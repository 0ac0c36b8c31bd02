"""Writes messages into one MCAP file, so that whatever was closed in a chunk survives the death of the writer.

MCAP: https://mcap.dev/spec. Profile `ros2`, message encoding `cdr`, schema encoding `ros2msg`.
"""

from __future__ import annotations

import contextlib
import io
import json
import sys
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import IO, Literal, cast

from mcap.writer import CompressionType, Writer

from services.recorder.ros_messages import to_cdr
from services.recorder.ros_schemas import schema_text
from shared.errors import HyrecroError, MessageError
from shared.messaging.channels import Channel
from shared.messaging.messages import Measurement, Message
from shared.messaging.sequence import SequenceCounter
from shared.runtime.health import source_of

CHUNK_BYTES = 1024 * 1024
"""A chunk closes at this size: MCAP's usual one, a compromise between compression and what a reader must load."""

RUN_METADATA = "hyrecro_run"
COUNTS_METADATA = "hyrecro_counts"
_LIBRARY = "hyrecro"
_NEVER = sys.maxsize
_UINT32_RANGE = 2**32


class RecordingError(HyrecroError):
    """The file cannot be written any further; what was closed before stays readable."""


@dataclass(slots=True)
class TopicCounts:
    """What came for one topic: num_missed by gaps in `seq`, num_restarts by `seq` going back."""

    num_received: int = 0
    num_missed: int = 0
    num_restarts: int = 0


@dataclass(slots=True)
class _Topic:
    """A topic of the file: its MCAP channel, what it carries, its counts, and who numbers its messages."""

    channel_id: int
    ros_type: str
    counts: TopicCounts = field(default_factory=TopicCounts)
    sources: dict[str, SequenceCounter] = field(default_factory=dict)

    def count(self, message: Message) -> None:
        self.counts.num_received += 1
        if not isinstance(message, Measurement):
            return
        counter = self.sources.setdefault(source_of(message), SequenceCounter())
        self.counts.num_restarts += counter.last_seq is not None and message.seq <= counter.last_seq
        self.counts.num_missed += counter.add(message.seq)


class _Output:
    """A stream that takes every byte or raises, remembers what is complete, and keeps nothing in this process."""

    def __init__(self, stream: IO[bytes]) -> None:
        self.num_complete_bytes = 0
        self._stream = stream
        self._position = 0

    def write(self, data: bytes) -> int:
        rest = memoryview(data)
        while rest:
            num_taken = self._stream.write(rest)
            self._position += num_taken
            rest = rest[num_taken:]
        return len(data)

    def tell(self) -> int:
        return self._position

    def flush(self) -> None:
        self._stream.flush()
        self.num_complete_bytes = self._position

    def cut(self) -> None:
        """Takes away what was begun and not completed, where the stream can."""
        if not self._stream.closed and self._stream.seekable():
            self._stream.truncate(self.num_complete_bytes)

    def close(self) -> None:
        self._stream.close()


class McapLog:
    """One recording. Not for several threads. Close it in `finally`: only then has it its index and its counts."""

    def __init__(
        self,
        target: Path | IO[bytes],
        channels: Iterable[Channel],
        metadata: Mapping[str, str],
        *,
        start_ns: int = 0,
        chunk_bytes: int = CHUNK_BYTES,
        compression: Literal["lz4", "zstd", "none"] = "lz4",
    ) -> None:
        """Begins a new file.

        target: path of a file that does not exist yet, or a binary stream, which is closed with the log.
        channels: those of the table; recorded ones are declared at once (a key with `*` when its first message comes).
        metadata: text stored at the head of the file: resolved configuration, version, seed.
        start_ns: simulated time at which the recording begins: a kept message older than that is logged at it.

        Raises:
            RecordingError: the file exists already or cannot be written.
            ValueError: two channels claim one topic with different ROS types.
        """
        self._output = _Output(_created(target) if isinstance(target, Path) else target)
        codec = CompressionType[compression.upper()]
        self._writer = Writer(cast("IO[bytes]", self._output), chunk_size=_NEVER, compression=codec)
        self._start_ns = start_ns
        self._chunk_bytes = chunk_bytes
        self._num_open_bytes = 0
        self._is_open = True
        self._topics: dict[str, _Topic] = {}
        self._schema_ids: dict[str, int] = {}
        try:
            self._writer.start(profile="ros2", library=_LIBRARY)
            self._writer.add_metadata(RUN_METADATA, dict(metadata))
            self._writer.flush()  # type: ignore[no-untyped-call]
        except OSError as error:
            raise self._failure(error) from error
        for channel in channels:
            if channel.is_recorded and "*" not in channel.topic:
                self._declare(channel)

    @property
    def is_open(self) -> bool:
        """Whether the log takes messages: not after `close`, nor after a failure."""
        return self._is_open

    @property
    def num_bytes(self) -> int:
        """Bytes handed to the operating system so far."""
        return self._output.tell()

    @property
    def counts(self) -> Mapping[str, TopicCounts]:
        """The counts by topic, of every topic declared."""
        return {name: topic.counts for name, topic in self._topics.items()}

    def write(self, channel: Channel, message: Message, received_ns: int) -> None:
        """Adds a message at the time it was measured; a command, which has no stamp, at `received_ns`.

        received_ns: simulated time of receipt. A message that came before by another way (a kept one that was asked
        for) is the caller's to leave out, or it counts as a restart.

        Raises:
            MessageError: the message is not what the channel carries, or its stamp is no ROS time.
            RecordingError: the disk refuses, now or before.
            ValueError: the channel's topic stands in the file with another ROS type.
        """
        if not self._is_open:
            raise RecordingError("the recording is closed")
        if type(message) is not channel.message:
            raise MessageError(f"{channel.key} carries {channel.message.__name__}, not {type(message).__name__}")
        stamp_ns = message.stamp_ns if isinstance(message, Measurement) else received_ns
        ros_type, data = to_cdr(message, stamp_ns)
        topic = self._declare(channel)
        if topic.ros_type != ros_type:
            raise ValueError(f"{channel.topic} is recorded as {topic.ros_type}, not as {ros_type}")
        topic.count(message)
        self._writer.add_message(
            topic.channel_id,
            log_time=max(stamp_ns, self._start_ns),
            publish_time=stamp_ns,
            data=cast("bytes", data),
            sequence=message.seq % _UINT32_RANGE if isinstance(message, Measurement) else topic.counts.num_received,
        )
        self._num_open_bytes += len(data)
        if self._num_open_bytes >= self._chunk_bytes:
            self.flush()

    def flush(self) -> None:
        """Closes the open chunk, if it holds messages, and hands it to the operating system.

        Called on a timer, it bounds what a killed process can lose. A power cut may lose more: nothing is synced.

        Raises:
            RecordingError: the disk refuses.
        """
        if not self._is_open:
            return
        try:
            self._writer.flush()  # type: ignore[no-untyped-call]
        except OSError as error:
            raise self._failure(error) from error
        self._num_open_bytes = 0

    def close(self) -> None:
        """Writes the last chunk, the counts and the index, and closes the stream. Closing again does nothing.

        Raises:
            RecordingError: the disk refuses; the chunks closed before stay readable.
        """
        if not self._is_open:
            return
        self.flush()
        try:
            counts = {name: json.dumps(asdict(topic.counts)) for name, topic in self._topics.items()}
            self._writer.add_metadata(COUNTS_METADATA, counts)
            self._writer.finish()  # type: ignore[no-untyped-call]
            self._output.flush()
            self._output.close()
        except OSError as error:
            raise self._failure(error) from error
        self._is_open = False

    def _declare(self, channel: Channel) -> _Topic:
        topic = self._topics.get(channel.topic)
        if topic is None:
            topic = _Topic(self._register(channel), channel.ros_type)
            self._topics[channel.topic] = topic
        elif topic.ros_type != channel.ros_type:
            raise ValueError(f"{channel.topic} is recorded as {topic.ros_type}, not as {channel.ros_type}")
        return topic

    def _register(self, channel: Channel) -> int:
        ros_type = channel.ros_type
        if ros_type not in self._schema_ids:
            text = schema_text(ros_type).encode()
            self._schema_ids[ros_type] = self._writer.register_schema(name=ros_type, encoding="ros2msg", data=text)
        return self._writer.register_channel(
            topic=channel.topic, message_encoding="cdr", schema_id=self._schema_ids[ros_type]
        )

    def _failure(self, error: OSError) -> RecordingError:
        """Ends the log after a disk error: a half-written chunk is cut off, if the disk lets it."""
        self._is_open = False
        with contextlib.suppress(OSError):
            self._output.cut()
        with contextlib.suppress(OSError):
            self._output.close()
        return RecordingError(f"the recording ended after {self._output.num_complete_bytes} bytes: {error.strerror}")


def _created(path: Path) -> IO[bytes]:
    """A new file without a buffer in this process.

    Raises:
        RecordingError: it exists already, or cannot be made.
    """
    try:
        return cast("IO[bytes]", io.FileIO(path, "x"))
    except OSError as error:
        raise RecordingError(f"{path}: cannot record into it: {error.strerror}") from error
