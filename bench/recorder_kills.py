"""Kills the recorder at random moments under full load, and counts what is in its files.

`python -m bench.recorder_kills --kills 30` starts a recorder each time, lets it record for a random time, sends SIGKILL
and compares what was published until then with what every whole chunk of the file holds.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import random
import shutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader
from rich.console import Console
from rich.table import Table

from bench.recorder_load import full_load
from shared.errors import HyrecroError
from shared.messaging.bus import Bus, is_reachable
from shared.messaging.channels import CHANNELS, RECORDER_STATUS
from shared.messaging.messages import RecorderStatus
from shared.runtime.config import BusConfig

KEYS = {channel.topic: channel.key for channel in CHANNELS}
_START_TIMEOUT_S = 60.0


@dataclass(frozen=True, slots=True)
class Kill:
    """What one kill cost. num_published: from the first message in the file to the kill, of the load's keys.

    num_lost_on_bus: gaps between messages in the file. num_lost_at_end: after the last one in the file, of each key.
    oldest_lost_s: how long before the kill the first of those was published. num_claimed: written, as the recorder had
    said a moment before; all of those are in the file.
    """

    recorded_s: float
    num_published: int
    num_in_file: int
    num_lost_on_bus: int
    num_lost_at_end: int
    oldest_lost_s: float
    num_claimed: int

    @property
    def balances(self) -> bool:
        """To the message, and nothing is missing that was said to be written."""
        accounted = self.num_in_file + self.num_lost_on_bus + self.num_lost_at_end
        return accounted == self.num_published and self.num_claimed <= self.num_in_file


def recovered(path: Path) -> dict[str, list[int]]:
    """The numbers of what every whole chunk holds, by key of the load, in the order of the file."""
    numbers: dict[str, list[int]] = {stream.channel.key: [] for stream in full_load()}
    with path.open("rb") as file, contextlib.suppress(McapError, ValueError, struct.error):  # where the file stops
        for _, channel, message in NonSeekingReader(file).iter_messages(log_time_order=False):
            if KEYS.get(channel.topic) in numbers:
                numbers[KEYS[channel.topic]].append(message.sequence)
    return numbers


def accounted(numbers: dict[str, list[int]], log: Path, killed_ns: int, recorded_s: float, num_claimed: int) -> Kill:
    """Compares a file's numbers with the log of the load."""
    published: dict[str, dict[int, int]] = {key: {} for key in numbers}
    for line in log.read_text().splitlines():
        key, seq, stamp_ns = line.split()
        if int(stamp_ns) <= killed_ns:
            published[key][int(seq)] = int(stamp_ns)
    total = num_gaps = 0
    lost_at_end_ns: list[int] = []
    for key, seqs in numbers.items():
        if not seqs:
            continue
        since_first = {seq: stamp_ns for seq, stamp_ns in published[key].items() if seq >= min(seqs)}
        total += len(since_first)
        num_gaps += max(seqs) - min(seqs) + 1 - len(set(seqs))
        lost_at_end_ns += [stamp_ns for seq, stamp_ns in since_first.items() if seq > max(seqs)]
    return Kill(
        recorded_s=recorded_s,
        num_published=total,
        num_in_file=sum(map(len, numbers.values())),
        num_lost_on_bus=num_gaps,
        num_lost_at_end=len(lost_at_end_ns),
        oldest_lost_s=(killed_ns - min(lost_at_end_ns, default=killed_ns)) / 1e9,
        num_claimed=num_claimed,
    )


@contextlib.contextmanager
def loaded_bus(folder: Path, seconds: float) -> Iterator[tuple[str, Path]]:
    """A router and the full load on a free port; its endpoint and the load's log."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        endpoint = f"tcp/127.0.0.1:{server.getsockname()[1]}"
    log = folder / "load.txt"
    router = _started("cli.main", "router", "--endpoint", endpoint)
    try:
        _wait_for(lambda: is_reachable(endpoint))
        load = _started("bench.recorder_load", "--endpoint", endpoint, "--seconds", f"{seconds}", "--log", f"{log}")
        try:
            yield endpoint, log
        finally:
            load.kill()
            load.wait()
    finally:
        router.terminate()
        router.wait()


def kill_once(endpoint: str, log: Path, folder: Path, name: str, seconds: float) -> Kill:
    """One recorder from its start to its SIGKILL after so many seconds of recording."""
    settings = {"bus.endpoint": endpoint, "recorder.directory": folder, "recorder.run": name}
    options = [part for key, value in settings.items() for part in ("--set", f"{key}={value}")]
    recorder = _started("services.recorder", "-q", *options)
    path = folder / name / "run.mcap"
    with Bus(BusConfig(endpoint=endpoint)) as bus:
        _wait_for(lambda: "recorder" in bus.alive() and path.stat().st_size > 1_000_000)
        begin_s = time.monotonic()
        time.sleep(seconds)
        status = bus.ask(RECORDER_STATUS, RecorderStatus)
    os.kill(recorder.pid, signal.SIGKILL)
    recorder.wait()
    killed_ns = time.monotonic_ns()
    keys = {stream.channel.key for stream in full_load()}
    num_claimed = sum(record.num_written for record in status.channels if record.key in keys) if status else 0
    kill = accounted(recovered(path), log, killed_ns, killed_ns / 1e9 - begin_s, num_claimed)
    shutil.rmtree(folder / name)
    return kill


def measure(num_kills: int, max_s: float, seed: int) -> list[Kill]:
    """So many kills, each after up to `max_s` of recording."""
    random_s = random.Random(seed)  # noqa: S311 - moments, not secrets
    with tempfile.TemporaryDirectory() as name, loaded_bus(Path(name), 3600.0) as (endpoint, log):
        folder = Path(name)
        return [kill_once(endpoint, log, folder, f"kill_{i}", random_s.uniform(0, max_s)) for i in range(num_kills)]


def _started(module: str, *arguments: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen(  # noqa: S603 - our own modules
        [sys.executable, "-m", module, *arguments], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )


def _wait_for(is_so: object) -> None:
    assert callable(is_so)
    deadline_s = time.monotonic() + _START_TIMEOUT_S
    while not is_so():
        if time.monotonic() > deadline_s:
            raise HyrecroError(f"not ready within {_START_TIMEOUT_S:g} s")
        time.sleep(0.05)


def main() -> None:
    """Prints a table, or JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=30)
    parser.add_argument("--max-s", type=float, default=3.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    kills = measure(arguments.kills, arguments.max_s, arguments.seed)
    if arguments.json:
        print(json.dumps([asdict(kill) | {"balances": kill.balances} for kill in kills], indent=1))
        return
    table = Table(
        "recorded s", "published", "in the file", "lost on the bus", "lost at the end", "oldest lost s", "balances"
    )
    for kill in kills:
        counts = (kill.num_published, kill.num_in_file, kill.num_lost_on_bus, kill.num_lost_at_end)
        table.add_row(f"{kill.recorded_s:.2f}", *map(str, counts), f"{kill.oldest_lost_s:.2f}", str(kill.balances))
    Console(width=110).print(table)


if __name__ == "__main__":
    main()
