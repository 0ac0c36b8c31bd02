"""Reads a recording back: its messages as they were sent, its metadata, its counts."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from mcap.exceptions import McapError
from mcap.reader import make_reader

from services.recorder.ros.reading import from_cdr
from services.recorder.tally import COUNTS_METADATA, END_METADATA, INCOMPLETE, RUN_METADATA
from shared.errors import InputFileError
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
                reader = make_reader(file)
                summary = reader.get_summary()
                metadata = {entry.name: dict(entry.metadata) for entry in reader.iter_metadata()}
        except (OSError, McapError) as error:
            raise InputFileError(f"{path}: not a complete recording: {error or type(error).__name__}") from error
        if summary is None or summary.statistics is None or RUN_METADATA not in metadata:
            raise InputFileError(f"{path}: not a complete recording of this project")
        self.metadata: dict[str, str] = metadata[RUN_METADATA]
        self.state = metadata.get(END_METADATA, {}).get("state", INCOMPLETE)
        self._counts = {topic: json.loads(text) for topic, text in metadata.get(COUNTS_METADATA, {}).items()}
        self._statistics = summary.statistics
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
        return sum(int(counts.get(name, 0)) for name in ("num_lost_on_bus", "num_lost_to_disk"))

    def messages(self, *channels: Channel) -> Iterator[m.Message]:
        """The messages of these channels in the order of their time.

        Raises:
            ValueError: a channel whose messages cannot be read back.
        """
        wanted = {topic: channel for topic in self._topics for channel in channels if _is_topic_of(topic, channel)}
        with self.path.open("rb") as file:
            for _, recorded, record in make_reader(file).iter_messages(topics=list(wanted)):
                yield from_cdr(wanted[recorded.topic], record.data, record.sequence, record.publish_time)


def _is_topic_of(topic: str, channel: Channel) -> bool:
    stem = channel.topic.removesuffix("*")
    return topic == channel.topic or (stem != channel.topic and topic.startswith(stem))
