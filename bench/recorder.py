"""How fast recordings are written: MB/s and CPU by compression, beside mcap's own writer and that of rosbags.

`python -m bench.recorder` writes the full load (an OS1-128 at 2048x10, a D435i at 1280x720 and 15 Hz, see
`bench.recorder_load`) into files, as fast as it goes, medians of several runs that take turns; all write the same CDR
bytes with chunks of 1 MiB. Then it records the load in time onto a slow disk, which takes so many MB/s and no more.
"""

from __future__ import annotations

import argparse
import json
import statistics
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, cast

from mcap.writer import CompressionType, Writer
from rich.console import Console
from rich.table import Table
from rosbags.rosbag2 import StoragePlugin, Writer as BagWriter

from bench.recorder_load import Stream, full_load
from services.recorder.chunk import Compression
from services.recorder.disk import Output, new_file
from services.recorder.mcap_log import McapLog
from services.recorder.records import Record, to_record
from services.recorder.ros.schemas import schema_text, typestore
from services.recorder.rotation import FileSeries
from services.recorder.run_writer import RunWriter
from shared.runtime.config import RecorderConfig

COMPRESSIONS: tuple[Compression, ...] = ("none", "lz4", "zstd")
CHUNK_BYTES = 1024 * 1024


@dataclass(frozen=True, slots=True)
class Speed:
    """Of one writer: uncompressed MB a second of wall time and of CPU; the file's size as a share of those."""

    writer: str
    compression: str
    mb_per_s: float
    mb_per_cpu_s: float
    size_ratio: float


@dataclass(frozen=True, slots=True)
class SlowDisk:
    """What became of the load on a disk that takes `disk_mb_per_s`; longest_put_ms: what the inbox waited for it."""

    disk_mb_per_s: float
    load_mb_per_s: float
    num_received: int
    num_written: int
    num_lost_to_disk: int
    longest_put_ms: float


def records_of(seconds: float) -> list[Record]:
    """The load of so many seconds in the order of its time. Equal messages share their bytes."""
    times = [
        (index / stream.rate_hz, stream) for stream in full_load() for index in range(int(seconds * stream.rate_hz))
    ]
    first: dict[str, Record] = {}
    records = []
    for time_s, stream in sorted(times, key=lambda entry: entry[0]):
        record = first.setdefault(stream.channel.key, _record(stream))
        stamp_ns = int(time_s * 1e9)
        records.append(replace(record, stamp_ns=stamp_ns, log_ns=stamp_ns))
    return records


def _record(stream: Stream) -> Record:
    return to_record(stream.channel, stream.message, 0, number=0)


def write_ours(path: Path, records: list[Record], compression: Compression) -> None:
    """The recorder's file."""
    log = McapLog(new_file(path), [], {}, chunk_bytes=CHUNK_BYTES, compression=compression)
    for record in records:
        log.add(record)
    log.flush()
    log.close()


def write_mcap(path: Path, records: list[Record], compression: Compression) -> None:
    """The writer of the mcap package."""
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=CHUNK_BYTES, compression=CompressionType[compression.upper()])
        writer.start("ros2")
        ids: dict[str, int] = {}
        for record in records:
            channel = record.channel
            if channel.key not in ids:
                schema = writer.register_schema(channel.ros_type, "ros2msg", schema_text(channel.ros_type).encode())
                ids[channel.key] = writer.register_channel(channel.topic, "cdr", schema)
            data = cast("bytes", record.data)
            writer.add_message(ids[channel.key], record.log_ns, data, record.stamp_ns)
        writer.finish()  # type: ignore[no-untyped-call]


def write_rosbags(path: Path, records: list[Record], compression: Compression) -> None:
    """The writer of rosbags, which writes rosbag2 folders; it compresses by zstd only."""
    with BagWriter(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections: dict[str, Any] = {}
        for record in records:
            channel = record.channel
            if channel.key not in connections:
                connections[channel.key] = writer.add_connection(channel.topic, channel.ros_type, typestore=typestore())
            writer.write(connections[channel.key], record.log_ns, record.data)


WRITERS: dict[str, Callable[[Path, list[Record], Compression], None]] = {
    "hyrecro": write_ours,
    "mcap": write_mcap,
    "rosbags": write_rosbags,
}


def speeds(folder: Path, seconds: float, num_runs: int) -> list[Speed]:
    """Every writer with every compression it has, in turns."""
    records = records_of(seconds)
    num_mb = sum(len(record.data) for record in records) / 1e6
    pairs = [(name, kind) for kind in COMPRESSIONS for name in WRITERS if name != "rosbags" or kind == "none"]
    runs: dict[tuple[str, Compression], list[tuple[float, float, float]]] = {pair: [] for pair in pairs}
    for run in range(num_runs):
        for name, kind in pairs:
            path = folder / f"{name}_{kind}_{run}.mcap"
            begin_s, begin_cpu_s = time.perf_counter(), time.process_time()
            WRITERS[name](path, records, kind)
            end = time.perf_counter() - begin_s, time.process_time() - begin_cpu_s
            runs[name, kind].append((*end, _take_away(path) / 1e6))
    return [
        Speed(name, kind, num_mb / wall_s, num_mb / cpu_s, size_mb / num_mb)
        for (name, kind), of in runs.items()
        for wall_s, cpu_s, size_mb in [[statistics.median(column) for column in zip(*of, strict=True)]]
    ]


def _take_away(path: Path) -> int:
    files = list(path.iterdir()) if path.is_dir() else [path]
    size = sum(file.stat().st_size for file in files)
    for file in files:
        file.unlink()
    return size


class SlowFile(Output):
    """A file on a disk of limited speed: a write takes as long as such a disk needs."""

    bytes_per_s = 1e6

    def write(self, data: bytes | memoryview) -> None:
        """Hands all bytes over, then waits."""
        super().write(data)
        time.sleep(len(data) / self.bytes_per_s)


def slow_disk(folder: Path, seconds: float, disk_mb_per_s: float, max_queue_mib: int) -> SlowDisk:
    """Records the load in time."""
    SlowFile.bytes_per_s = disk_mb_per_s * 1e6
    config = RecorderConfig(min_free_mib=0)
    series = FileSeries(folder, [], {}, config, {}, lambda path: SlowFile(path.open("wb", buffering=0)))
    writer = RunWriter(series, max_queue_bytes=max_queue_mib * 1024 * 1024, chunk_period_s=0.5)
    records, longest_s, begin_s = records_of(seconds), 0.0, time.monotonic()
    for record in records:
        time.sleep(max(0.0, begin_s + record.stamp_ns / 1e9 - time.monotonic()))
        put_s = time.monotonic()
        writer.put(record)
        longest_s = max(longest_s, time.monotonic() - put_s)
    writer.close(2 * seconds)
    progress = series.progress()
    return SlowDisk(
        disk_mb_per_s=disk_mb_per_s,
        load_mb_per_s=sum(len(record.data) for record in records) / 1e6 / seconds,
        num_received=writer.num_received.total(),
        num_written=sum(num_written for num_written, _ in progress.values()),
        num_lost_to_disk=sum(num_lost for _, num_lost in progress.values()),
        longest_put_ms=1e3 * longest_s,
    )


def main() -> None:
    """Prints the tables, or JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=2.0)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--disk-mb-per-s", type=float, default=40.0)
    parser.add_argument("--queue-mib", type=int, default=64)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        figures = speeds(Path(name), arguments.seconds, arguments.runs)
        slow = slow_disk(Path(name), arguments.seconds * 2, arguments.disk_mb_per_s, arguments.queue_mib)
    if arguments.json:
        print(json.dumps({"speeds": [asdict(each) for each in figures], "slow_disk": asdict(slow)}, indent=1))
        return
    _show(figures, slow)


def _show(figures: list[Speed], slow: SlowDisk) -> None:
    peers = {each.compression: each for each in figures if each.writer == "mcap"}
    table = Table("writer", "compression", "MB/s", "MB a CPU second", "times the mcap package", "size")
    for each in figures:
        ratio = each.mb_per_cpu_s / peers[each.compression].mb_per_cpu_s
        figures_text = (f"{each.mb_per_s:.0f}", f"{each.mb_per_cpu_s:.0f}", f"{ratio:.2f}", f"{each.size_ratio:.2f}")
        table.add_row(each.writer, each.compression, *figures_text)
    Console(width=110).print(table)
    Console(width=110).print(asdict(slow))


if __name__ == "__main__":
    main()
