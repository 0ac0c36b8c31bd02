"""One recording from its start to its end: which channels, how many messages, what became of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path

from services.recorder.records import Record
from services.recorder.rotation import FileSeries
from services.recorder.run_writer import RunWriter
from services.recorder.selection import Selection
from shared.messaging.channels import Channel
from shared.messaging.messages import ChannelRecord
from shared.messaging.values import MAX_COUNT
from shared.runtime.config import RecorderConfig


class Run:
    """Takes the records of the chosen channels.

    folder: exists. metadata: kept at the head of each file. kept: the last record of channels that each file needs, by
    key. first_file: the number of the first file, above 0 where a run goes on.

    Raises:
        RecordingError: the disk refuses, or the file exists.
    """

    def __init__(
        self,
        config: RecorderConfig,
        folder: Path,
        channels: Iterable[Channel],
        selection: Selection,
        metadata: Mapping[str, str],
        kept: Mapping[str, Record],
        first_file: int = 0,
    ) -> None:
        self.selection = selection
        self._folder = folder
        self._channels: dict[str, Channel] = {}
        series = FileSeries(
            folder,
            [channel for channel in channels if channel in selection],
            {**metadata, "channels": " ".join(selection.patterns)},
            config,
            {key: record for key, record in kept.items() if record.channel in selection},
            first_file=first_file,
        )
        self._writer = RunWriter(
            series, max_queue_bytes=config.max_queue_mib * 1024 * 1024, chunk_period_s=config.chunk_period_s
        )
        self._final_outstanding: Counter[str] | None = None
        self._end_text = ""

    @property
    def is_open(self) -> bool:
        """Whether it has not been closed: what comes is written, or counted as lost."""
        return self._final_outstanding is None

    @property
    def is_recording(self) -> bool:
        """Whether what comes is written."""
        return self.is_open and not self.text

    @property
    def text(self) -> str:
        """Why it stopped by itself; "" if it did not."""
        return self._end_text or self._writer.failure

    @property
    def path(self) -> Path:
        """The newest file."""
        return self._writer.series.path

    @property
    def num_files(self) -> int:
        """So far."""
        return self._writer.series.num_files

    @property
    def num_bytes(self) -> int:
        """Of all files."""
        return self._writer.series.num_bytes

    def put(self, record: Record) -> None:
        """Lets a record of a chosen channel be written."""
        self._channels[record.channel.key] = record.channel
        self._writer.put(record)

    def close(self, outstanding: Mapping[Channel, int], max_wait_s: float) -> None:
        """Completes the run. outstanding: what is known to have been sent and has not come."""
        self._final_outstanding = Counter()
        for channel, num_missed in outstanding.items():
            self._channels[channel.key] = channel
            self._writer.add_missed(channel, num_missed)
        if not self._writer.close(max_wait_s):
            self._end_text = f"{self._folder}: the disk has not answered for {2 * max_wait_s:g} s"

    def records(self, outstanding: Mapping[str, int]) -> tuple[ChannelRecord, ...]:
        """The counts of every key that something came of. outstanding: until the run is closed."""
        outstanding = outstanding if self._final_outstanding is None else self._final_outstanding
        writer, progress = self._writer, self._writer.series.progress()
        records = []
        for key, channel in sorted(self._channels.items()):
            num_received = writer.num_received[key]
            num_written, num_lost = progress.get(key, (0, 0))
            num_missed = max(0, min(writer.num_missed[key] + outstanding.get(key, 0), MAX_COUNT - num_received))
            records.append(
                ChannelRecord(
                    key=key,
                    num_received=num_received,
                    num_written=num_written,
                    num_lost_on_bus=num_missed,
                    num_lost_to_disk=num_lost,
                    num_published=None if channel.is_command else num_received + num_missed,
                )
            )
        return tuple(records)
