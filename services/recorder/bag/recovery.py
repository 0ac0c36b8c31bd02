"""Makes a whole recording of what is left of a damaged one."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from mcap.records import Channel, McapRecord, Message, Metadata, Schema
from mcap.writer import CompressionType, Writer

from services.recorder.bag.mcap_blocks import Damage, McapBlocks
from services.recorder.bag.mcap_index import index_of
from services.recorder.bag.overview import Progress, counts_of, written_counts
from services.recorder.tally import COUNTS_METADATA, END_METADATA, INCOMPLETE
from shared.errors import InputFileError
from shared.messaging.channels import EVENTS, channel_of_topic
from shared.messaging.sequence import SequenceCounter

_NEVER_BY_SIZE = 2**63


@dataclass(frozen=True, slots=True)
class Recovered:
    """What came back, by topic, and what did not.

    num_lost: by topic, as the file's own counts say, or else the gaps in `seq`; what was lost at the end of a file that
    has no counts is not known. num_nameless: messages of channels whose names were lost with another chunk.
    """

    num_messages: dict[str, int]
    num_lost: dict[str, int]
    num_nameless: int
    num_chunks: int
    damage: tuple[Damage, ...]
    first_ns: int
    last_ns: int

    @property
    def num_lost_bytes(self) -> int:
        """That held messages, or may have."""
        return sum(damage.num_bytes for damage in self.damage if damage.has_data)

    @property
    def has_losses(self) -> bool:
        """Whether messages are missing that were in the file, or may have been."""
        return bool(self.num_lost_bytes or self.num_nameless or any(self.num_lost.values()))


def recover(source: Path, out: Path, on_progress: Progress = lambda _: None) -> Recovered:
    """Copies every whole chunk into a new file, in its order, with index, metadata and counts. The source stays.

    Raises:
        InputFileError: the source is no recording, or `out` exists or cannot be written.
    """
    blocks = McapBlocks(source)
    try:
        with out.open("xb") as file:
            try:
                recovered = _copied(blocks, _Copy(file, source), on_progress)
            except BaseException:
                out.unlink()
                raise
    except OSError as error:
        raise InputFileError(f"{out}: cannot be written: {error.strerror}") from error
    return recovered


def _copied(blocks: McapBlocks, copy: _Copy, on_progress: Progress) -> Recovered:
    for block in blocks.blocks():
        for record in block.records:
            copy.add(record)
        copy.end_block()
        on_progress(block.end / blocks.num_bytes)
    if not copy.num_messages:
        raise InputFileError(f"{copy.source}: has no whole chunk: nothing can be recovered")
    num_lost = copy.finish(blocks.damage)
    return Recovered(
        num_messages=dict(sorted(copy.num_messages.items())),
        num_lost=num_lost,
        num_nameless=copy.num_nameless,
        num_chunks=blocks.num_chunks,
        damage=tuple(blocks.damage),
        first_ns=copy.first_ns,
        last_ns=copy.last_ns,
    )


class _Copy:
    """The new file: a chunk for each of the old one."""

    def __init__(self, file: IO[bytes], source: Path) -> None:
        self.source = source
        self.num_messages: Counter[str] = Counter()
        self.num_nameless = 0
        self.first_ns, self.last_ns = 2**63, 0
        self._writer = Writer(file, chunk_size=_NEVER_BY_SIZE, compression=CompressionType.LZ4)
        self._writer.start(profile="ros2", library="hyrecro")
        self._metadata: dict[str, dict[str, str]] = {}
        self._schemas: dict[int, int] = {0: 0}
        self._channels: dict[int, tuple[int, str]] = {}
        self._sequences: dict[str, SequenceCounter] = {}
        if (index := index_of(source)) is not None:  # should the chunk that declares them be lost
            for record in (*index.summary.schemas.values(), *index.summary.channels.values()):
                self.add(record)

    def add(self, record: McapRecord) -> None:
        match record:
            case Schema() if record.id not in self._schemas:
                self._schemas[record.id] = self._writer.register_schema(record.name, record.encoding, record.data)
            case Channel() if record.id not in self._channels:
                schema_id = self._schemas.get(record.schema_id, 0)
                new = self._writer.register_channel(record.topic, record.message_encoding, schema_id, record.metadata)
                self._channels[record.id] = (new, record.topic)
            case Message():
                self._add_message(record)
            case Metadata() if record.name not in (COUNTS_METADATA, END_METADATA):
                self._writer.add_metadata(record.name, dict(record.metadata))
            case Metadata():
                self._metadata[record.name] = dict(record.metadata)

    def end_block(self) -> None:
        """Closes the chunk."""
        self._writer.flush()  # type: ignore[no-untyped-call]

    def finish(self, damage: list[Damage]) -> dict[str, int]:
        """Writes counts and index; returns what was lost, by topic."""
        counts = {topic: json.dumps(self._counts(topic)) for topic in sorted(self._topics())}
        reason = f"recovered from {self.source.name}"
        if damage:
            reason += f": {'; '.join(map(str, damage))}"
        self._writer.add_metadata(COUNTS_METADATA, counts)
        self._writer.add_metadata(END_METADATA, {"state": INCOMPLETE, "reason": reason})
        self._writer.finish()  # type: ignore[no-untyped-call]
        lost = {topic: counts_of(written_counts(text)).num_lost for topic, text in counts.items()}
        return {topic: num for topic, num in lost.items() if num}

    def _topics(self) -> list[str]:
        return [topic for _, topic in self._channels.values()]

    def _counts(self, topic: str) -> dict[str, int | None]:
        """As the recorder counted, if its counts are there; what it wrote and is no more counts as lost to disk."""
        num_here = self.num_messages[topic]
        text = self._metadata.get(COUNTS_METADATA, {}).get(topic)
        known = {} if text is None else written_counts(text)
        if "num_written" in known:
            num_lost = (known.get("num_received") or 0) + (known.get("num_repeated") or 0) - num_here
            return {**known, "num_written": num_here, "num_lost_to_disk": max(num_lost, 0)}
        counter = self._sequences.get(topic)
        return {"num_written": num_here, "num_lost_to_disk": 0 if counter is None else counter.num_missed}

    def _add_message(self, message: Message) -> None:
        if message.channel_id not in self._channels:
            self.num_nameless += 1
            return
        channel_id, topic = self._channels[message.channel_id]
        self._writer.add_message(
            channel_id, message.log_time, message.data, message.publish_time, sequence=message.sequence
        )
        self.num_messages[topic] += 1
        self.first_ns, self.last_ns = min(self.first_ns, message.log_time), max(self.last_ns, message.log_time)
        channel = channel_of_topic(topic)
        if channel is not None and channel.key != EVENTS.key and not channel.is_command:
            self._sequences.setdefault(topic, SequenceCounter()).add(message.sequence)
