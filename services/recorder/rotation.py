"""The files of one run, one after the other: run.mcap, run_001.mcap ... each readable by itself."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from services.recorder.disk import BYTES_A_MIB, Output, RecordingError, check_room, new_file
from services.recorder.mcap_log import McapLog
from services.recorder.records import Record
from services.recorder.tally import RUN_METADATA, Tally
from shared.messaging.channels import Channel
from shared.runtime.config import RecorderConfig

_NS_PER_S = 1_000_000_000


class FileSeries:
    """Writes records; begins a new file when one is large or long enough. Not for several threads.

    A disk that refuses ends it: `failure` says why, the file is completed as far as the disk lets, and what still comes
    is counted as lost. Each file begins with the last message of every kept channel that speaks only on change.
    """

    def __init__(
        self,
        folder: Path,
        channels: Sequence[Channel],
        metadata: Mapping[str, str],
        config: RecorderConfig,
        kept: Mapping[str, Record],
        open_file: Callable[[Path], Output] = new_file,
        first_file: int = 0,
    ) -> None:
        """Begins file number `first_file`. metadata: stored at the head of each. kept: by key, from before the start.

        Raises:
            RecordingError: the disk refuses, or the file exists.
        """
        self.failure = ""
        self.num_files = first_file
        self.path = folder
        self._folder, self._channels, self._metadata, self._config = folder, channels, metadata, config
        self._kept, self._open_file = dict(kept), open_file
        self._done, self._tally = Tally(), Tally()
        self._num_done_bytes = 0
        self._begin_ns: int | None = None
        self._lock = threading.Lock()
        """Held where counts go from the open file to those that are done."""
        self._log: McapLog | None = self._new_log()

    @property
    def num_bytes(self) -> int:
        """Of all files."""
        return self._num_done_bytes + (self._log.num_bytes if self._log else 0)

    def add(self, record: Record) -> None:
        """Writes a record, or counts it as lost."""
        self._rotate(record.log_ns)
        if is_repeated_in_each_file(record.channel):
            self._kept[record.channel.key] = record
        counts = self._tally.of(record.channel)
        counts.num_received += 1
        counts.num_lost_on_bus = max(0, counts.num_lost_on_bus + record.num_missed)  # -1: it was counted, and came late
        self._write(record)

    def add_lost(self, channel: Channel, num_received: int, num_missed: int) -> None:
        """Counts records that came and for which there was no room, and what was missed before them on the bus."""
        counts = self._tally.of(channel)
        counts.num_received += num_received
        counts.num_dropped += num_received
        counts.num_lost_on_bus += num_missed

    def flush(self) -> None:
        """Closes the open chunk."""
        if self._log is not None:
            try:
                self._log.flush()
            except RecordingError as error:
                self._fail(str(error))

    def close(self) -> None:
        """Completes the last file. Further records count as lost."""
        self.flush()
        self._end_file(self.failure)

    def progress(self) -> dict[str, tuple[int, int]]:
        """By key: how many records stand in whole chunks, how many never will. May be asked from another thread."""
        progress = {}
        with self._lock:
            written = dict(self._log.num_written) if self._log else {}
            for key in self._done.keys.keys() | self._tally.keys.copy().keys():
                done, now = self._done.keys.get(key), self._tally.keys.get(key)
                num_lost = (now.num_dropped if self._log else now.num_received) if now else 0
                if done is not None:
                    num_lost += done.num_lost_to_disk
                progress[key] = (written.get(key, 0) + (done.num_written if done else 0), num_lost)
        return progress

    def _write(self, record: Record) -> None:
        if self._log is not None:
            try:
                self._log.add(record)
            except RecordingError as error:
                self._fail(str(error))

    def _rotate(self, log_ns: int) -> None:
        if self._begin_ns is None:
            self._begin_file(log_ns)
        elif self._log is not None and self._is_full(self._log, log_ns - self._begin_ns):
            self.flush()
            self._end_file(self.failure)
            if not self.failure:
                try:
                    self._log = self._new_log()
                except RecordingError as error:
                    self.failure = str(error)
                else:
                    self._begin_file(log_ns)

    def _is_full(self, log: McapLog, length_ns: int) -> bool:
        config = self._config
        is_large = config.max_file_mib > 0 and log.num_bytes >= config.max_file_mib * BYTES_A_MIB
        return is_large or (config.max_file_s > 0 and length_ns >= config.max_file_s * _NS_PER_S)

    def _new_log(self) -> McapLog:
        config = self._config
        check_room(self._folder, config.min_free_mib)
        path = self._folder / file_name(self.num_files)
        log = McapLog(
            self._open_file(path),
            self._channels,
            {RUN_METADATA: {**self._metadata, "file": str(self.num_files)}},
            chunk_bytes=config.chunk_size_kib * 1024,
            compression=config.compression,
            check_room=lambda num_bytes: check_room(self._folder, config.min_free_mib, num_bytes),
        )
        self.path = path
        self.num_files += 1
        return log

    def _begin_file(self, log_ns: int) -> None:
        self._begin_ns = log_ns
        for record in self._kept.values():
            self._tally.of(record.channel).num_repeated += 1
            self._write(replace(record, log_ns=max(record.stamp_ns, log_ns), num_missed=0, is_repeated=True))

    def _fail(self, reason: str) -> None:
        self.failure = reason
        self._end_file(reason)

    def _end_file(self, reason: str) -> None:
        """Completes the open file with its counts. What comes without a file is received, and never written."""
        log = self._log
        if log is not None:
            self._tally.set_written(log.num_written)
            try:
                log.close(self._tally.metadata(reason))
            except RecordingError as error:
                self.failure = self.failure or str(error)
        with self._lock:
            self._num_done_bytes += log.num_bytes if log else 0
            self._done.add(self._tally)
            self._log, self._tally = None, Tally()


def file_name(number: int) -> str:
    """Of a file of a run, counted from 0."""
    return "run.mcap" if number == 0 else f"run_{number:03d}.mcap"


def num_files_in(folder: Path) -> int:
    """How many files of a run there are in a folder, up to the first that is not."""
    return next(number for number in itertools.count() if not (folder / file_name(number)).exists())


def is_repeated_in_each_file(channel: Channel) -> bool:
    """Whether a file is not readable without the channel's last message: descriptions, static transforms."""
    return channel.is_kept and channel.rate_hz is None
