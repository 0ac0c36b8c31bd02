"""What a recording holds and what it says of its own losses: from its index, or from its whole chunks."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from services.recorder.bag.mcap_index import Index, index_of
from services.recorder.bag.recorded import RecordingReader
from services.recorder.tally import COMPLETE, COUNTS_METADATA, END_METADATA, INCOMPLETE, RUN_METADATA
from shared.messaging.channels import Channel, channel_of_topic

Progress = Callable[[float], None]
"""Told the share of the work that is done, 0..1."""


@dataclass(frozen=True, slots=True)
class TopicCounts:
    """What the recorder counted of a topic; None: not known. num_lost: on the bus and to disk."""

    num_published: int | None = None
    num_received: int | None = None
    num_written: int | None = None
    num_lost_on_bus: int = 0
    num_lost_to_disk: int = 0

    @property
    def num_lost(self) -> int:
        """Published, and not in the file."""
        return self.num_lost_on_bus + self.num_lost_to_disk


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic of the file. channel: None where this version knows none."""

    topic: str
    ros_type: str
    num_messages: int
    counts: TopicCounts
    channel: Channel | None


@dataclass(frozen=True, slots=True)
class Overview:
    """first_ns, last_ns: stamps of the first and the last message. problems: why it is INCOMPLETE, a line each.

    has_index: whether its writer closed it.
    """

    path: Path
    num_bytes: int
    num_chunks: int
    first_ns: int
    last_ns: int
    has_index: bool
    state: str
    problems: tuple[str, ...]
    metadata: Mapping[str, Mapping[str, str]]
    topics: tuple[Topic, ...]

    @property
    def duration_s(self) -> float:
        """Simulated time from the first to the last message."""
        return (self.last_ns - self.first_ns) / 1e9

    @property
    def num_messages(self) -> int:
        """Of all topics."""
        return sum(topic.num_messages for topic in self.topics)

    @property
    def run(self) -> Mapping[str, str]:
        """What the recorder wrote at the head: version, seed, config."""
        return self.metadata.get(RUN_METADATA, {})


@dataclass(frozen=True, slots=True)
class _Contents:
    """What was found, whichever way it was read."""

    types: dict[str, str]
    num_messages: Mapping[str, int]
    num_chunks: int
    first_ns: int
    last_ns: int
    metadata: dict[str, dict[str, str]]


def overview_of(path: Path, on_progress: Progress = lambda _: None) -> Overview:
    """From the index where the file has one; a file without, or with a damaged one, is read from begin to end.

    Raises:
        InputFileError: there is no such file, or it is no recording.
    """
    if (index := index_of(path)) is not None:
        return _overview(path, _of_index(index), [], has_index=True)
    reader = RecordingReader(path)
    contents = _from_chunks(reader, on_progress)
    return _overview(path, contents, [str(damage) for damage in reader.damage], has_index=reader.blocks.is_complete)


def _of_index(index: Index) -> _Contents:
    channels, schemas = index.summary.channels, index.summary.schemas
    counts = index.statistics.channel_message_counts
    return _Contents(
        types={of.topic: schemas[of.schema_id].name if of.schema_id in schemas else "" for of in channels.values()},
        num_messages={of.topic: counts.get(id_, 0) for id_, of in channels.items()},
        num_chunks=index.statistics.chunk_count,
        first_ns=index.statistics.message_start_time,
        last_ns=index.statistics.message_end_time,
        metadata=index.metadata,
    )


def _from_chunks(reader: RecordingReader, on_progress: Progress) -> _Contents:
    counts: Counter[str] = Counter()
    first_ns, last_ns = None, 0
    for recorded in reader.messages():
        counts[recorded.channel.topic] += 1
        first_ns = recorded.log_ns if first_ns is None else min(first_ns, recorded.log_ns)
        last_ns = max(last_ns, recorded.log_ns)
        on_progress(reader.num_read_bytes / reader.blocks.num_bytes)
    return _Contents(
        types=reader.types,
        num_messages=counts + reader.unknown,
        num_chunks=reader.blocks.num_chunks,
        first_ns=first_ns or 0,
        last_ns=last_ns,
        metadata=reader.metadata,
    )


def _overview(path: Path, contents: _Contents, damage: list[str], *, has_index: bool) -> Overview:
    written = {topic: written_counts(text) for topic, text in contents.metadata.get(COUNTS_METADATA, {}).items()}
    topics = tuple(
        Topic(
            topic=topic,
            ros_type=ros_type,
            num_messages=contents.num_messages.get(topic, 0),
            counts=counts_of(written.get(topic, {})),
            channel=channel_of_topic(topic),
        )
        for topic, ros_type in sorted(contents.types.items())
    )
    lost = [f"{topic.topic}: {topic.counts.num_lost} messages lost" for topic in topics if topic.counts.num_lost]
    end = contents.metadata.get(END_METADATA, {})
    problems = (*damage, *([end["reason"]] if end.get("reason") else []), *lost)
    is_complete = has_index and not problems and end.get("state", COMPLETE) == COMPLETE
    return Overview(
        path=path,
        num_bytes=path.stat().st_size,
        num_chunks=contents.num_chunks,
        first_ns=contents.first_ns,
        last_ns=contents.last_ns,
        has_index=has_index,
        state=COMPLETE if is_complete else INCOMPLETE,
        problems=problems,
        metadata=contents.metadata,
        topics=topics,
    )


def written_counts(text: str) -> dict[str, int | None]:
    """What a recorder wrote of a topic, from its JSON; nothing where that is damaged."""
    try:
        written = json.loads(text)
    except (ValueError, RecursionError):
        return {}
    is_whole = isinstance(written, dict) and all(isinstance(value, int | None) for value in written.values())
    return written if is_whole else {}


def counts_of(written: Mapping[str, int | None]) -> TopicCounts:
    """What a recorder wrote of a topic. Earlier versions knew `num_missed` alone, by gaps in `seq`."""
    return TopicCounts(
        num_published=written.get("num_published"),
        num_received=written.get("num_received"),
        num_written=written.get("num_written"),
        num_lost_on_bus=written.get("num_lost_on_bus", written.get("num_missed")) or 0,
        num_lost_to_disk=written.get("num_lost_to_disk") or 0,
    )
