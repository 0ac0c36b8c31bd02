"""N robots on one router: rates, CPU, delay and losses for 1, 2, 4 and 8 of them, and a model that foretells them.

`python -m bench.many` measures and writes JSON; the model is fitted on one and two robots and checked on the others.
`python -m bench.many --predict 20 --pace 1 --cores 8 --link-mbps 100` says what so many robots need.

Robots are slow by default: a fifth of real time, so that transforms go at 20 Hz and scans of 512x128 beams at 2 Hz.
Without shared memory, as between hosts.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import socket
import statistics
import subprocess
import sys
import time
from collections import defaultdict
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import psutil

from bench.many_model import SLOW, Load, Model, report
from shared.messaging.bus import Bus
from shared.messaging.channels import CHANNELS, CLOCK, HEALTH, Channel, Delivery
from shared.messaging.codec import decode
from shared.messaging.inbox import Inbox
from shared.messaging.messages import Clock, Health
from shared.runtime.config import BusConfig

MODULES = {"sim": "services.sim", "lidar": "services.sensors", "mapper": "services.mapper"}
SETUPS = (("sim",), ("lidar", "sim"), ("mapper", "lidar", "sim"))
PING = replace(CLOCK, key="bench/ping", delivery=Delivery.EVERY, is_kept=False)
PING_HZ = 50.0
SETTLE_S = 3.0
INBOX_BYTES = 256 * 1024 * 1024


class Robots:
    """The router's and the robots' processes by kind, and a session in each robot's namespace."""

    def __init__(self, stack: contextlib.ExitStack, num_robots: int, kinds: tuple[str, ...], pace: float) -> None:
        self._stack, self.num_robots, self.kinds, self.pace = stack, num_robots, kinds, pace
        self._processes: dict[str, list[psutil.Process]] = defaultdict(list)
        endpoint = _free_endpoint()
        self._start("router", "cli.main", "router", "--endpoint", endpoint)
        self.configs = [
            BusConfig(endpoint=endpoint, namespace=f"robot_{n}", shared_memory_mib=0) for n in range(num_robots)
        ]
        self.buses = [stack.enter_context(Bus(config)) for config in self.configs]
        for kind in kinds:
            for config in self.configs:
                settings = [f"bus.endpoint={endpoint}", f"bus.namespace={config.namespace}"]
                settings += [f"sim.real_time_factor={pace}", "bus.shared_memory_mib=0"]
                self._start(kind, MODULES[kind], *(part for setting in settings for part in ("--set", setting)))
        for bus in self.buses:
            while not set(kinds) <= bus.alive():
                time.sleep(0.1)
        time.sleep(SETTLE_S)

    def cpu_s(self) -> dict[str, float]:
        """Seconds of CPU used so far, by kind."""
        times = {kind: [process.cpu_times() for process in those] for kind, those in self._processes.items()}
        return {kind: sum(each.user + each.system for each in those) for kind, those in times.items()}

    def _start(self, kind: str, *module: str) -> None:
        process = subprocess.Popen(  # noqa: S603 - our own modules
            [sys.executable, "-m", *module], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        self._processes[kind].append(psutil.Process(process.pid))
        self._stack.callback(_end, process)


def measure(robots: Robots, seconds: float) -> Load:
    """What so many robots do and cost, from heartbeat to heartbeat."""
    sizes = _sizes(robots.configs[0])
    inboxes = [_subscribed(bus, HEALTH) for bus in robots.buses]
    cpu_before, began_s = robots.cpu_s(), time.monotonic()
    delays_ms = _pings(robots, seconds)
    cpu, elapsed_s = robots.cpu_s(), time.monotonic() - began_s
    sent_hz, received_hz, num_lost = _traffic(inboxes)
    heard = {key: rate_hz for key, rate_hz in sent_hz.items() if key in received_hz}
    per_robot = 1 / robots.num_robots
    centiles = statistics.quantiles(delays_ms, n=100)
    return Load(
        num_robots=robots.num_robots,
        real_time_factor=robots.pace,
        kinds=robots.kinds,
        cpu={kind: round((cpu[kind] - cpu_before[kind]) / elapsed_s, 4) for kind in cpu},
        rate_hz={key: round(rate * per_robot, 2) for key, rate in sorted(sent_hz.items())},
        bytes_a_message={key: size for key, size in sorted(sizes.items()) if key in sent_hz},
        routed_hz=round(sum(heard.values()) + sum(received_hz.values()) + 2 * PING_HZ * robots.num_robots, 1),
        routed_mb_per_s=round(
            sum((heard.get(key, 0.0) + hz) * sizes.get(key, 0) for key, hz in received_hz.items()) * 1e-6, 3
        ),
        num_lost=num_lost,
        delay_p50_ms=round(centiles[49], 2),
        delay_p99_ms=round(centiles[98], 2),
    )


def _pings(robots: Robots, seconds: float) -> list[float]:
    """Milliseconds a small message takes from one session of a robot through the router to another."""
    delays_ms: list[float] = []
    with contextlib.ExitStack() as stack:
        inboxes = [_subscribed(stack.enter_context(Bus(config)), PING) for config in robots.configs]
        for bus in robots.buses:
            bus.advertise(PING)
        for number in range(int(seconds * PING_HZ)):
            due_s = time.monotonic() + 1 / PING_HZ
            for bus in robots.buses:
                bus.publish(PING, Clock(stamp_ns=time.monotonic_ns(), seq=number, frame=""))
            time.sleep(max(0.0, due_s - time.monotonic()))
        time.sleep(0.5)
        for inbox in inboxes:
            while (parcel := inbox.take(0.0)) is not None:
                delays_ms.append((parcel.received_ns - decode(Clock, parcel.payload).stamp_ns) * 1e-6)
    return delays_ms


def _traffic(inboxes: list[Inbox]) -> tuple[dict[str, float], dict[str, float], int]:
    """Messages a second sent and received by key, of all robots; how many were missed or dropped."""
    sent_hz: defaultdict[str, float] = defaultdict(float)
    received_hz: defaultdict[str, float] = defaultdict(float)
    num_lost = 0
    for inbox in inboxes:
        heartbeats: dict[str, list[Health]] = defaultdict(list)
        while (parcel := inbox.take(0.0)) is not None:
            health = decode(Health, parcel.payload)
            heartbeats[health.service].append(health)
        for those in heartbeats.values():
            first = {count.key: count for count in those[0].channels}
            seconds = those[-1].uptime_s - those[0].uptime_s
            for count in those[-1].channels:
                before, key = first.get(count.key, replace(count, num_sent=0)), count.key.removeprefix("hyrecro/")
                sent_hz[key] += (count.num_sent - before.num_sent) / seconds
                received_hz[key] += (count.num_received - before.num_received) / seconds
                num_lost += count.num_missed + count.num_dropped - before.num_missed - before.num_dropped
    return _above_zero(sent_hz), _above_zero(received_hz), num_lost


def _above_zero(rates: dict[str, float]) -> dict[str, float]:
    return {key: rate for key, rate in rates.items() if rate > 0}


def _sizes(config: BusConfig) -> dict[str, int]:
    """Mean bytes of a message by key, of what comes within a second and a half."""
    with Bus(config) as bus:
        inbox = _subscribed(bus, *CHANNELS)
        time.sleep(1.5)
        sizes: dict[str, list[int]] = defaultdict(list)
        while (parcel := inbox.take(0.0)) is not None:
            sizes[parcel.key.removeprefix("hyrecro/")].append(len(parcel.payload))
    return {key: round(statistics.mean(those)) for key, those in sizes.items()}


def _subscribed(bus: Bus, *channels: Channel) -> Inbox:
    inbox = Inbox(max_bytes=INBOX_BYTES)
    for channel in channels:
        bus.subscribe(channel, inbox, is_observer=True)
    return inbox


def _end(process: subprocess.Popen[bytes]) -> None:
    process.terminate()
    process.wait(15.0)


def _free_endpoint() -> str:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return f"tcp/127.0.0.1:{server.getsockname()[1]}"


def main() -> None:
    """Measures, or predicts from what was measured."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("docs/benchmarks/many.json"))
    parser.add_argument("--robots", type=int, nargs="*", default=[1, 2, 4, 8])
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--pace", type=float, default=SLOW, help="seconds of simulated time a second")
    parser.add_argument("--predict", type=int, metavar="ROBOTS", help="only say what so many need")
    parser.add_argument("--cores", type=float, default=2.0)
    parser.add_argument("--link-mbps", type=float, default=1000.0)
    arguments = parser.parse_args()
    loads, pace = _read(arguments.out), arguments.pace
    if arguments.predict is not None:
        print(Model.fitted(loads).prediction(arguments.predict, arguments.cores, arguments.link_mbps, pace))
        return
    for num_robots in arguments.robots:
        for kinds in SETUPS:
            print(f"{num_robots} x {' + '.join(kinds)} ...", file=sys.stderr)
            with contextlib.ExitStack() as stack:
                load = measure(Robots(stack, num_robots, kinds, pace), arguments.seconds)
            this = (num_robots, kinds, pace)
            loads = [old for old in loads if (old.num_robots, old.kinds, old.real_time_factor) != this] + [load]
            arguments.out.write_text(json.dumps([asdict(each) for each in loads], indent=1) + "\n")
    print(report(loads))


def _read(path: Path) -> list[Load]:
    loads: list[dict[str, Any]] = json.loads(path.read_text()) if path.exists() else []
    return [Load(**{**load, "kinds": tuple(load["kinds"])}) for load in loads]


if __name__ == "__main__":
    main()
