"""All files of one run together: by topic, what is in them and what is in none, also between a file and the next.

A recorder that was killed counts nothing at the end of its file, so it is counted here: by the numbers of the messages,
and by what the publishers say in their heartbeats, which are recorded too.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from services.recorder.bag.overview import Overview, Progress, overview_of
from services.recorder.bag.recorded import Recorded, RecordingReader, UnreadableError
from services.recorder.bus_counts import BusCounts
from services.recorder.rotation import file_name, num_files_in
from services.recorder.tally import COMPLETE, INCOMPLETE
from shared.errors import InputFileError
from shared.messaging.channels import EVENTS
from shared.messaging.messages import Event, Health


@dataclass(frozen=True, slots=True)
class TopicBalance:
    """num_messages: in the files, those at their heads that stand in an earlier file left out: num_repeated.

    num_missing: published, as far as is known, and in no file; None for commands, which nobody numbers.
    """

    topic: str
    num_messages: int
    num_repeated: int
    num_missing: int | None

    @property
    def num_published(self) -> int | None:
        """Since the first that is in a file."""
        return None if self.num_missing is None else self.num_messages + self.num_missing


@dataclass(frozen=True, slots=True)
class RunBalance:
    """files: in their order."""

    folder: Path
    files: tuple[Overview, ...]
    topics: tuple[TopicBalance, ...]

    @property
    def num_missing(self) -> int:
        """Of all topics."""
        return sum(topic.num_missing or 0 for topic in self.topics)

    @property
    def state(self) -> str:
        """COMPLETE where every file is, and nothing is missing between them."""
        is_complete = self.num_missing == 0 and all(file.state == COMPLETE for file in self.files)
        return COMPLETE if is_complete else INCOMPLETE


def run_files(folder: Path) -> list[Path]:
    """The files of a run in their order.

    Raises:
        InputFileError: the folder holds none.
    """
    files = [folder / file_name(number) for number in range(num_files_in(folder))]
    if not files:
        raise InputFileError(f"{folder}: holds no run.mcap")
    return files


def balance_of(folder: Path, on_progress: Progress = lambda _: None) -> RunBalance:
    """Reads every message of a run.

    Raises:
        InputFileError: the folder holds no run, or one of its files is no recording.
    """
    files = run_files(folder)
    num_bytes, num_done = sum(path.stat().st_size for path in files), 0
    count = _Count()
    for path in files:
        reader = RecordingReader(path)
        for recorded in reader.messages():
            count.add(recorded)
            on_progress((num_done + reader.num_read_bytes) / num_bytes)
        num_done += path.stat().st_size
    return RunBalance(folder, tuple(overview_of(path) for path in files), count.topics())


class _Count:
    """Follows the messages of a run as its recorder would have, had it lived on."""

    def __init__(self) -> None:
        self._bus = BusCounts()
        self._last: dict[tuple[str, str], tuple[int, int]] = {}
        self._num_messages: Counter[str] = Counter()
        self._num_repeated: Counter[str] = Counter()
        self._num_missing: Counter[str] = Counter()
        self._commands: set[str] = set()
        self._topics: dict[str, str] = {}

    def add(self, recorded: Recorded) -> None:
        key = recorded.channel.key
        self._topics[key] = recorded.channel.topic
        if recorded.channel.is_command:
            self._commands.add(key)
            self._num_messages[key] += 1
            return
        source = _source_of(recorded)
        number = recorded.seq, recorded.stamp_ns
        if self._last.get((key, source)) == number:
            self._num_repeated[key] += 1
            return
        self._last[key, source] = number
        self._num_messages[key] += 1
        self._num_missing[key] += self._bus.took(key, source, recorded.seq)
        if recorded.channel.message is Health:
            self._hear(recorded)

    def topics(self) -> tuple[TopicBalance, ...]:
        outstanding = self._bus.outstanding()
        return tuple(
            TopicBalance(
                topic,
                self._num_messages[key],
                self._num_repeated[key],
                None if key in self._commands else self._num_missing[key] + outstanding[key],
            )
            for key, topic in sorted(self._topics.items())
        )

    def _hear(self, recorded: Recorded) -> None:
        try:
            health = recorded.message()
        except UnreadableError:
            return
        assert isinstance(health, Health)
        self._bus.heard(health)


def _source_of(recorded: Recorded) -> str:
    """Who numbers a message: events of all services share one topic."""
    if recorded.channel.key != EVENTS.key:
        return ""
    try:
        event = recorded.message()
    except UnreadableError:
        return ""
    assert isinstance(event, Event)
    return event.source
