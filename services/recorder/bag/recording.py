"""Reads a recording back: its messages as they were sent, its metadata, its counts."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import count
from pathlib import Path

from mcap.reader import SeekingReader
from mcap.records import Message as McapMessage

from services.recorder.bag.overview import written_counts
from services.recorder.ros.reading import from_cdr
from services.recorder.tally import COUNTS_METADATA, END_METADATA, INCOMPLETE, RUN_METADATA
from shared.errors import InputFileError, MessageError
from shared.mcap_chunks import BROKEN, HEAD_BYTES, chunk_of, records_of, size_of
from shared.messaging import messages as m
from shared.messaging.channels import Channel


@dataclass(frozen=True, slots=True)
class TopicSummary:
    """What a recording holds of one topic, and what is known to be missing: lost on the bus, or to disk."""

    topic: str
    num_messages: int
    num_missed: int


class Recording:
    """A file that was closed. state: COMPLETE, or INCOMPLETE where something is known to be missing.

    Raises:
        InputFileError: the file is missing, truncated or no recording of this project.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            with path.open("rb") as file:
                reader = SeekingReader(file, record_size_limit=size_of(file))
                summary = reader.get_summary()
                metadata = {entry.name: dict(entry.metadata) for entry in reader.iter_metadata()} if summary else {}
        except (OSError, *BROKEN) as error:
            reason = str(error) or type(error).__name__
            raise InputFileError(f"{path}: not a complete recording: {reason}") from error
        if summary is None or summary.statistics is None or RUN_METADATA not in metadata:
            raise InputFileError(f"{path}: not a complete recording of this project")
        self.metadata: dict[str, str] = metadata[RUN_METADATA]
        self.state = metadata.get(END_METADATA, {}).get("state", INCOMPLETE)
        self._counts = {topic: written_counts(text) for topic, text in metadata.get(COUNTS_METADATA, {}).items()}
        self._statistics = summary.statistics
        self._chunks = sorted(summary.chunk_indexes, key=lambda index: index.message_start_time)
        self._topics = {channel.topic: id_ for id_, channel in summary.channels.items()}

    @property
    def duration_s(self) -> float:
        """Simulated time from the first to the last message."""
        return (self._statistics.message_end_time - self._statistics.message_start_time) / 1e9

    def topics(self) -> list[TopicSummary]:
        """Every topic, by name."""
        counts = self._statistics.channel_message_counts
        return [
            TopicSummary(topic, counts.get(id_, 0), self._num_missed(topic))
            for topic, id_ in sorted(self._topics.items())
        ]

    def _num_missed(self, topic: str) -> int:
        counts = self._counts.get(topic, {})
        return sum(counts.get(name) or 0 for name in ("num_lost_on_bus", "num_lost_to_disk"))

    def messages(self, *channels: Channel) -> Iterator[m.Message]:
        """The messages of these channels in the order of their time.

        Raises:
            InputFileError: the file is damaged. ValueError: a channel whose messages cannot be read back.
        """
        wanted = {id_: of for topic, id_ in self._topics.items() for of in channels if _is_topic_of(topic, of)}
        try:
            for record in self._in_time(wanted.keys()):
                yield from_cdr(wanted[record.channel_id], record.data, record.sequence, record.publish_time)
        except (OSError, MessageError, *BROKEN) as error:
            raise InputFileError(f"{self.path}: is damaged: {error or type(error).__name__}") from error

    def _in_time(self, channel_ids: Collection[int]) -> Iterator[McapMessage]:
        """The messages of these channels. Chunks may overlap in time: what comes before the next one is given."""
        waiting: list[tuple[int, int, McapMessage]] = []
        order = count()
        with self.path.open("rb") as file:
            for index in self._chunks:
                while waiting and waiting[0][0] < index.message_start_time:
                    yield heappop(waiting)[2]
                file.seek(index.chunk_start_offset + HEAD_BYTES)
                for record in records_of(chunk_of(file.read(min(index.chunk_length, size_of(file))))):
                    if isinstance(record, McapMessage) and record.channel_id in channel_ids:
                        heappush(waiting, (record.log_time, next(order), record))
        while waiting:
            yield heappop(waiting)[2]


def _is_topic_of(topic: str, channel: Channel) -> bool:
    stem = channel.topic.removesuffix("*")
    return topic == channel.topic or (stem != channel.topic and topic.startswith(stem))
