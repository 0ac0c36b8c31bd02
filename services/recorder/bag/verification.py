"""Reads every message of a recording, and says of each topic what is there and what is not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from services.recorder.bag.overview import Overview, Progress, overview_of
from services.recorder.bag.recorded import Recorded, RecordingReader, UnreadableError
from services.recorder.tally import END_METADATA, INCOMPLETE
from shared.messaging.messages import Measurement
from shared.messaging.sequence import SequenceCounter
from shared.runtime.health import source_of

_MAX_PROBLEMS = 20
"""That are told of one topic."""


@dataclass(slots=True)
class TopicReport:
    """What was found of one topic.

    num_gaps: messages missing between others, by `seq`; num_restarts: times that `seq` went back. num_backward: stamps
    earlier than the one before. num_unreadable: that could not be decoded. num_expected: by the file's own counts,
    None where it has none. first_ns, last_ns: stamps.
    """

    topic: str
    num_messages: int = 0
    num_gaps: int = 0
    num_restarts: int = 0
    num_backward: int = 0
    num_unreadable: int = 0
    num_expected: int | None = None
    num_lost: int = 0
    first_ns: int | None = None
    last_ns: int | None = None
    problems: list[str] = field(default_factory=list)

    @property
    def is_fine(self) -> bool:
        """Whether nothing is missing and everything was read."""
        is_all = self.num_expected is None or self.num_expected == self.num_messages
        return is_all and not (self.num_gaps or self.num_unreadable or self.num_lost)


@dataclass(slots=True)
class Verification:
    """problems: of the file as a whole: damage, a missing end, messages of no channel."""

    overview: Overview
    topics: dict[str, TopicReport]
    problems: list[str]

    @property
    def is_fine(self) -> bool:
        """Whether nothing was lost, here or when it was recorded."""
        return not self.problems and all(topic.is_fine for topic in self.topics.values())


def verified(path: Path, on_progress: Progress = lambda _: None) -> Verification:
    """Reads all of a recording: checksums of chunks, each message, numbers, stamps.

    Raises:
        InputFileError: there is no such file, or it is no recording.
    """
    reader = RecordingReader(path)
    followers: dict[str, _Follower] = {}
    for recorded in reader.messages():
        topic = recorded.channel.topic
        followers.setdefault(topic, _Follower(topic)).add(recorded)
        on_progress(reader.num_read_bytes / reader.blocks.num_bytes)
    overview = overview_of(path)
    reports = {topic.topic: TopicReport(topic.topic) for topic in overview.topics}
    reports |= {topic: follower.report for topic, follower in followers.items()}
    _compare(reports, overview)
    problems = [str(damage) for damage in reader.damage]
    problems += [f"{topic}: {num} messages of no channel known here" for topic, num in reader.unknown.items()]
    end = reader.metadata.get(END_METADATA, {})
    if end.get("state") == INCOMPLETE:
        problems.append(f"recorded as INCOMPLETE{': ' + end['reason'] if end.get('reason') else ''}")
    return Verification(overview, dict(sorted(reports.items())), problems)


def _compare(reports: Mapping[str, TopicReport], overview: Overview) -> None:
    """With what the file's index and its recorder say."""
    for topic in overview.topics:
        report = reports[topic.topic]
        report.num_lost = topic.counts.num_lost
        if overview.has_index and topic.channel is not None:
            report.num_expected = topic.num_messages


class _Follower:
    """Follows the messages of one topic."""

    def __init__(self, topic: str) -> None:
        self.report = TopicReport(topic)
        self._sources: dict[str, SequenceCounter] = {}
        self._last_ns: dict[str, int] = {}

    def add(self, recorded: Recorded) -> None:
        self.report.num_messages += 1
        try:
            message = recorded.message()
        except UnreadableError as error:
            self.report.num_unreadable += 1
            if len(self.report.problems) < _MAX_PROBLEMS:
                self.report.problems.append(str(error))
            return
        if isinstance(message, Measurement):
            self._follow(message)

    def _follow(self, message: Measurement) -> None:
        report, source = self.report, source_of(message)
        counter = self._sources.setdefault(source, SequenceCounter())
        is_late = counter.is_late(message.seq)
        is_back = not is_late and counter.last_seq is not None and message.seq <= counter.last_seq
        report.num_restarts += is_back
        missed = counter.add(message.seq)
        report.num_gaps += 0 if is_back else missed
        report.num_backward += message.stamp_ns < self._last_ns.get(source, 0)
        self._last_ns[source] = message.stamp_ns
        report.first_ns = message.stamp_ns if report.first_ns is None else min(report.first_ns, message.stamp_ns)
        report.last_ns = message.stamp_ns if report.last_ns is None else max(report.last_ns, message.stamp_ns)
