"""The messages of a recording in the order in which they came, each decoded when it is asked for."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from mcap.records import Channel as McapChannel, McapRecord, Message as McapMessage, Metadata, Schema

from services.recorder.bag.mcap_blocks import Damage, McapBlocks
from services.recorder.bag.mcap_index import index_of
from services.recorder.ros.reading import from_cdr
from shared.errors import MessageError
from shared.messaging.channels import Channel, channel_of_topic
from shared.messaging.messages import Message


class UnreadableError(MessageError):
    """Bytes in a recording that are not the message they should be."""


@dataclass(frozen=True, slots=True)
class Recorded:
    """One message as it stands in the file. log_ns: simulated time it was logged at; stamp_ns: it was measured at."""

    channel: Channel
    seq: int
    log_ns: int
    stamp_ns: int
    data: bytes

    def message(self) -> Message:
        """The message.

        Raises:
            UnreadableError: the bytes are no such message.
        """
        try:
            return from_cdr(self.channel, self.data, self.seq, self.stamp_ns)
        except (MessageError, ValueError) as error:
            raise UnreadableError(f"{self.channel.topic}, message {self.seq}: not readable: {error}") from error


class RecordingReader:
    """One pass over a recording, from its beginning to its end, also where it was cut off or damaged.

    wanted: which channels; by default all. unknown: how many messages were left out, by topic: no channel of this
    version, or not told which. metadata: by name, as far as they have been met.

    Raises:
        InputFileError: there is no such file.
    """

    def __init__(self, path: Path, wanted: Callable[[Channel], bool] = lambda _: True) -> None:
        self.blocks = McapBlocks(path)
        self.unknown: Counter[str] = Counter()
        self.metadata: dict[str, dict[str, str]] = {}
        self.num_read_bytes = 0
        self._wanted = wanted
        self._types: dict[int, str] = {}
        self._topics: dict[int, str] = {}
        self._schemas: dict[int, int] = {}
        self._channels: dict[int, Channel | None] = {}
        self._add_summary(path)

    @property
    def types(self) -> dict[str, str]:
        """Topic -> ROS type of each topic that has been declared so far."""
        return {topic: self._types.get(self._schemas[id_], "") for id_, topic in self._topics.items()}

    @property
    def damage(self) -> list[Damage]:
        """What could not be read so far."""
        return self.blocks.damage

    def messages(self) -> Iterator[Recorded]:
        """The messages of the wanted channels.

        Raises:
            InputFileError: the file is no MCAP file.
        """
        for block in self.blocks.blocks():
            self.num_read_bytes = block.end
            for record in block.records:
                if isinstance(record, McapMessage):
                    channel = self._channels.get(record.channel_id)
                    if channel is None:
                        self.unknown[self._topics.get(record.channel_id, f"channel {record.channel_id}")] += 1
                    elif self._wanted(channel):
                        yield Recorded(channel, record.sequence, record.log_time, record.publish_time, record.data)
                elif isinstance(record, Metadata):
                    self.metadata[record.name] = dict(record.metadata)
                elif isinstance(record, Schema | McapChannel):
                    self._declare(record)

    def _add_summary(self, path: Path) -> None:
        """Its channels stand in the first chunk, and again at the end: known from there if the first chunk is lost."""
        if (index := index_of(path)) is not None:
            for record in (*index.summary.schemas.values(), *index.summary.channels.values()):
                self._declare(record)

    def _declare(self, record: McapRecord) -> None:
        if isinstance(record, Schema):
            self._types[record.id] = record.name
            return
        assert isinstance(record, McapChannel)
        channel = channel_of_topic(record.topic)
        is_ours = channel is not None and channel.ros_type == self._types.get(record.schema_id)
        self._topics[record.id], self._schemas[record.id] = record.topic, record.schema_id
        self._channels[record.id] = channel if is_ours and record.message_encoding == "cdr" else None
