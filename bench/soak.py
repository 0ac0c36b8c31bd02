"""Whether the pipeline grows while it runs for long: `python -m bench.soak --minutes 60`.

`hyrecro up` as a user starts it; the robot climbs there and back again and again, and everything is recorded, of which
only the newest files are kept. Every 10 s of each process: memory, open files, threads; of the machine: the bus's
shared memory; of joint states and scans: how much later than the quickest of the same 10 s they come. The first part,
the warm-up, is left out of the growth: by then the map knows the whole way, and takes up what it does not know only.
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from bench.processes import named_children
from shared.messaging.bus import Bus
from shared.messaging.channels import JOINTS_STATE, LIDAR_POINTS
from shared.messaging.codec import decode
from shared.messaging.inbox import Inbox
from shared.messaging.messages import Measurement
from shared.runtime.config import CONFIGS_DIR, BusConfig
from shared.runtime.process_load import ProcessLoad
from shared.runtime.shared_memory import bus_memory_bytes

_PERIOD_S = 10.0
_WARM_UP = 0.2
"""Of the whole time, but at least one way there and back."""
_LAP_S = 200.0
_SPEED = "0.5"
"""In rad/s; a lap takes three minutes then."""
_MAX_FILE_MIB = 256
_NUM_KEPT_FILES = 2
_READY_S = 120.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Sample:
    """One process at one time."""

    time_s: float
    name: str
    rss_mb: float
    shared_mb: float
    num_open_files: int
    num_threads: int
    cpu_ratio: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Machine:
    """Bus and latency at one time; delays are above the least of the period."""

    time_s: float
    bus_memory_mb: float
    delay_p50_ms: dict[str, float]
    delay_p99_ms: dict[str, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Growth:
    """One process after the warm-up: by a line through all samples, and the means of their first and last tenth."""

    name: str
    rss_first_mb: float
    rss_last_mb: float
    rss_growth: float
    num_open_files: tuple[int, int]
    num_threads: tuple[int, int]


def there_and_back(path: Path) -> None:
    """Writes the shipped climb, followed by itself the other way round."""
    with (CONFIGS_DIR / "trajectories" / "climb.csv").open(newline="") as file:
        header, *rows = list(csv.reader(file))
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([header, *rows, *rows[-2::-1]])


@contextlib.contextmanager
def pipeline(folder: Path, endpoint: str) -> Iterator[subprocess.Popen[bytes]]:
    """`hyrecro up`, ready."""
    settings = [f"bus.endpoint={endpoint}", f"recorder.directory={folder}", f"recorder.max_file_mib={_MAX_FILE_MIB}"]
    command = [sys.executable, "-m", "cli.main", "up", *(part for each in settings for part in ("--set", each))]
    log = folder / "up.log"
    with log.open("wb") as output:
        process = subprocess.Popen(command, stderr=output, stdout=output)  # noqa: S603 - our own command
    try:
        deadline_s = time.monotonic() + _READY_S
        while "up at" not in log.read_text():
            if process.poll() is not None or time.monotonic() > deadline_s:
                raise RuntimeError(f"the pipeline did not start: {log.read_text()[-500:]}")
            time.sleep(0.2)
        yield process
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(60)


class Climber:
    """Plays the trajectory again and again."""

    def __init__(self, trajectory: Path, endpoint: str) -> None:
        self._command = [sys.executable, "-m", "cli.main", "robot", "play", str(trajectory), "--speed", _SPEED]
        self._command += ["--set", f"bus.endpoint={endpoint}"]
        self._process: subprocess.Popen[bytes] | None = None
        self.num_laps = self.num_failed = 0

    def check(self) -> None:
        """Begins anew when a lap is over."""
        code = self._process.poll() if self._process is not None else None
        if self._process is not None and code is None:
            return
        self.num_laps += code == 0
        self.num_failed += code not in (0, None)
        self._process = subprocess.Popen(self._command)  # noqa: S603 - our own command

    def stop(self) -> None:
        """Ends the lap."""
        if self._process is not None:
            self._process.terminate()
            self._process.wait(20)


class Delays:
    """How late messages come, above the quickest of a period; simulated time runs with the wall's."""

    def __init__(self, bus: Bus) -> None:
        self._inbox = Inbox(max_bytes=2**28)
        for channel in (JOINTS_STATE, LIDAR_POINTS):
            bus.subscribe(channel, self._inbox)

    def of_period(self, seconds: float) -> tuple[dict[str, float], dict[str, float]]:
        """Takes what comes for so long; p50 and p99 by key in milliseconds."""
        late_ms: defaultdict[str, list[float]] = defaultdict(list)
        deadline_s = time.monotonic() + seconds
        while time.monotonic() < deadline_s:
            if (parcel := self._inbox.take(0.1)) is not None and not parcel.is_replay:
                message = decode(parcel.channel.message, parcel.payload)
                assert isinstance(message, Measurement)
                late_ms[parcel.channel.key].append((parcel.received_ns - message.stamp_ns) / 1e6)
        above = {key: np.array(values) - min(values) for key, values in late_ms.items()}
        return tuple(  # type: ignore[return-value]
            {key: round(float(np.percentile(values, share)), 2) for key, values in above.items()} for share in (50, 99)
        )


class Processes:
    """The processes of the pipeline; one that was started again is followed on, and counted."""

    def __init__(self, up_pid: int) -> None:
        self._up = psutil.Process(up_pid)
        self._loads = {name: (process.pid, ProcessLoad(process.pid)) for name, process in self._running().items()}
        self.restarted: list[str] = []

    def look(self, time_s: float) -> list[Sample]:
        """One sample of each."""
        samples = []
        for name, process in self._running().items():
            if name not in self._loads or self._loads[name][0] != process.pid:
                self._loads[name] = (process.pid, ProcessLoad(process.pid))
                self.restarted.append(name)
            with contextlib.suppress(psutil.NoSuchProcess):  # it has ended since; the next look finds another
                samples.append(_sample(name, time_s, self._loads[name][1]))
        return samples

    def _running(self) -> dict[str, psutil.Process]:
        return named_children(self._up)


def soak(minutes: float, folder: Path) -> tuple[list[Sample], list[Machine], dict[str, Any]]:
    """Runs it; the samples, and what became of laps and processes."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        endpoint = f"tcp/127.0.0.1:{server.getsockname()[1]}"
    there_and_back(folder / "there_and_back.csv")
    climber = Climber(folder / "there_and_back.csv", endpoint)
    samples: list[Sample] = []
    machine: list[Machine] = []
    with pipeline(folder, endpoint) as up, Bus(BusConfig(endpoint=endpoint)) as bus:
        processes = Processes(up.pid)
        delays = Delays(bus)
        begin_s = time.monotonic()
        try:
            while (time_s := time.monotonic() - begin_s) < minutes * 60:
                climber.check()
                p50_ms, p99_ms = delays.of_period(_PERIOD_S)
                samples += processes.look(time_s)
                shared_mb = round(bus_memory_bytes() / 1e6, 1)
                machine.append(
                    Machine(time_s=time_s, bus_memory_mb=shared_mb, delay_p50_ms=p50_ms, delay_p99_ms=p99_ms)
                )
                _forget_old_files(folder)
                print(f"{time_s / 60:.1f} of {minutes:g} minutes, lap {climber.num_laps + 1}", file=sys.stderr)
        finally:
            climber.stop()
    went = {"minutes": minutes, "num_laps": climber.num_laps, "num_failed_laps": climber.num_failed}
    return samples, machine, went | {"restarted": processes.restarted}


def _sample(name: str, time_s: float, process: ProcessLoad) -> Sample:
    load = process.look()
    return Sample(
        time_s=round(time_s, 1),
        name=name,
        rss_mb=round(load.rss_bytes / 1e6, 3),
        shared_mb=round(load.shared_memory_bytes / 1e6, 3),
        num_open_files=load.num_open_files,
        num_threads=load.num_threads,
        cpu_ratio=round(load.cpu_ratio, 3),
    )


def _forget_old_files(folder: Path) -> None:
    files = [path for path in folder.glob("*/run*.mcap") if not path.parent.is_symlink()]  # not again as `latest`
    files.sort(key=os.path.getmtime)
    for path in files[:-_NUM_KEPT_FILES]:
        path.unlink()


def growths(samples: list[Sample], minutes: float) -> list[Growth]:
    """What each process grew by after the warm-up.

    Raises:
        ValueError: too short a run to say.
    """
    warm_s = max(_WARM_UP * minutes * 60, _LAP_S)
    rows = []
    for name in dict.fromkeys(sample.name for sample in samples):
        after = [sample for sample in samples if sample.name == name and sample.time_s >= warm_s]
        if len(after) < 10:
            raise ValueError(f"{minutes:g} minutes are too few: the warm-up alone takes {warm_s / 60:.1f}")
        time_s, rss_mb = np.array([(sample.time_s, sample.rss_mb) for sample in after]).T
        slope_mb_per_s, _ = np.polyfit(time_s, rss_mb, 1)
        tenth = max(1, len(after) // 10)
        files, threads = ([getattr(s, field) for s in after] for field in ("num_open_files", "num_threads"))
        rows.append(
            Growth(
                name=name,
                rss_first_mb=float(rss_mb[:tenth].mean()),
                rss_last_mb=float(rss_mb[-tenth:].mean()),
                rss_growth=float(slope_mb_per_s * (time_s[-1] - time_s[0]) / rss_mb.mean()),
                num_open_files=(files[0], files[-1]),
                num_threads=(threads[0], threads[-1]),
            )
        )
    return rows


def tables(rows: list[Growth], machine: list[Machine], minutes: float) -> str:
    """Processes, then bus and delays at the beginning and the end, as Markdown."""
    lines = ["| process | MB, first tenth | last tenth | growth | open files | threads |", "|---|---|---|---|---|---|"]
    lines += [
        f"| {row.name} | {row.rss_first_mb:.1f} | {row.rss_last_mb:.1f} | {100 * row.rss_growth:+.2f} % "
        f"| {row.num_open_files[0]} -> {row.num_open_files[1]} | {row.num_threads[0]} -> {row.num_threads[1]} |"
        for row in rows
    ]
    after = [each for each in machine if each.time_s >= max(_WARM_UP * minutes * 60, _LAP_S)]
    tenth = max(1, len(after) // 10)
    lines += ["", "| of the machine | first tenth | last tenth |", "|---|---|---|"]
    memory = [float(np.mean([each.bus_memory_mb for each in part])) for part in (after[:tenth], after[-tenth:])]
    lines.append(f"| shared memory of the bus, MB | {memory[0]:.1f} | {memory[1]:.1f} |")
    for key in sorted(after[0].delay_p50_ms):
        for name in ("delay_p50_ms", "delay_p99_ms"):
            first, last = (
                float(np.median([getattr(each, name)[key] for each in part]))
                for part in (after[:tenth], after[-tenth:])
            )
            lines.append(f"| {key}, {name[6:9]} of the delay, ms | {first:.1f} | {last:.1f} |")
    return "\n".join(lines)


def main() -> None:
    """Runs it; tables on stdout, all samples in a file if asked for."""
    parser = argparse.ArgumentParser(prog="python -m bench.soak", description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--out", type=Path, help="growth and samples as JSON")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        samples, machine, went = soak(arguments.minutes, Path(folder))
    rows = growths(samples, arguments.minutes)
    if arguments.out is not None:
        figures = went | {"growth": [asdict(row) for row in rows]}
        figures |= {"machine": [asdict(each) for each in machine], "samples": [asdict(each) for each in samples]}
        arguments.out.write_text(json.dumps(figures) + "\n")
    print(", ".join(f"{name} {value or 'none'}" for name, value in went.items()), end="\n\n")
    print(tables(rows, machine, arguments.minutes))


if __name__ == "__main__":
    main()
