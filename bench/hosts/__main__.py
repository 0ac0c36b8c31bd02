"""`python -m bench.hosts`: a robot's host and a base, a router on each, over a link that delays, loses and is cut.

What a robot says (`bench.hosts.talker`) is heard on both hosts. Needs root, iproute2 and /dev/net/tun.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import subprocess
import sys
import time
from pathlib import Path
from typing import IO, Any, cast

from bench.hosts.network import ADDRESSES, Network, network, on_host
from bench.hosts.wire import Quality

HEAD = "| loss | delay | Mbit/s | heard on | clock | leg/state | lidar/points |\n|---|---|---|---|---|---|---|"
KEYS = ("clock", "leg/state", "lidar/points")
ENDPOINTS = {host: f"tcp/{address}:7447" for host, address in ADDRESSES.items()}
SETTLE_S, CUT_S = 1.5, 10.0


class Hosts:
    """Routers on both hosts, who speaks on the robot, who listens on both."""

    def __init__(self, wire: Network, stack: contextlib.ExitStack, router_options: str) -> None:
        self.wire, self._stack = wire, stack
        robot, base = ENDPOINTS["robot"] + router_options, ENDPOINTS["base"]
        self._start("robot", "cli.main", "router", "--endpoint", robot)
        self._start("base", "cli.main", "router", "--endpoint", base, "--connect", robot)
        self._start("robot", "bench.hosts.talker", "speak", ENDPOINTS["robot"])
        self._listeners = {
            host: self._start(host, "bench.hosts.talker", "listen", endpoint) for host, endpoint in ENDPOINTS.items()
        }
        for listener in self._listeners.values():
            cast(IO[str], listener.stdout).readline()

    def heard(self) -> dict[str, Any]:
        """By host and key, what came since the last call."""
        heard = {}
        for host, listener in self._listeners.items():
            commands = cast(IO[str], listener.stdin)
            commands.write("\n")
            commands.flush()
            heard[host] = json.loads(cast(IO[str], listener.stdout).readline())
        return heard

    def _start(self, host: str, *module: str) -> subprocess.Popen[str]:
        process = subprocess.Popen(  # noqa: S603 - our own modules
            on_host(host, sys.executable, "-m", *module), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self._stack.callback(_end, process)
        return process


def case(hosts: Hosts, quality: Quality, seconds: float, cut_s: float = 0.0) -> dict[str, Any]:
    """What is heard in so many seconds; with a cut, from `SETTLE_S` before it until so many seconds after."""
    hosts.wire.set_quality(quality)
    time.sleep(SETTLE_S)
    hosts.heard()
    hosts.wire.set_quality(quality)
    began_s = time.monotonic()
    if cut_s:
        time.sleep(SETTLE_S)
        hosts.wire.set_quality(Quality(quality.loss, quality.delay_s, is_cut=True))
        time.sleep(cut_s)
        hosts.wire.set_quality(quality)
    time.sleep(seconds)
    carried = hosts.wire.set_quality(quality)
    mbit_per_s = round(carried.get("num_bytes", 0) * 8e-6 / (time.monotonic() - began_s), 2)
    return {
        "loss": quality.loss,
        "delay_s": quality.delay_s,
        "cut_s": cut_s,
        "mbit_per_s": mbit_per_s,
        **hosts.heard(),
    }


def table(cases: list[dict[str, Any]]) -> str:
    """Markdown: a line for each case and host."""
    lines = [HEAD]
    for each in cases:
        cut = f", cut {each['cut_s']:g} s" if each["cut_s"] else ""
        for host in ADDRESSES:
            heard = " | ".join(_cell(each[host].get(key)) for key in KEYS)
            delay = f"{1e3 * each['delay_s']:g} ms{cut}"
            lines.append(f"| {each['loss']:.0%} | {delay} | {each['mbit_per_s']} | {host} | {heard} |")
    return "\n".join(lines)


def _cell(heard: dict[str, float] | None) -> str:
    if heard is None:
        return "nothing"
    times = f"{heard['late_p50_ms']:g} ms, {heard['late_max_ms']:g} ms, {heard['longest_gap_s']:g} s"
    return f"{heard['num_received']:g} of {heard['num_sent']:g}; {times}"


def _end(process: subprocess.Popen[str]) -> None:
    process.terminate()
    process.wait(10.0)


def main() -> None:
    """Runs the cases that are asked for, adds them to a JSON file, and prints them as a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("docs/benchmarks/hosts.json"))
    parser.add_argument("--seconds", type=float, default=5.0, help="of each case")
    parser.add_argument("--loss-percent", type=float, nargs="*", default=[0, 1, 5])
    parser.add_argument("--delay-ms", type=float, nargs="*", default=[0, 20, 100])
    parser.add_argument("--cut", action="store_true", help="also a cut of 10 s")
    parser.add_argument("--router-options", default="", help="behind the robot's endpoint, such as '#so_sndbuf=131072'")
    arguments = parser.parse_args()
    cases = []
    with network() as wire, contextlib.ExitStack() as stack:
        hosts = Hosts(wire, stack, arguments.router_options)
        for loss in arguments.loss_percent:
            for delay in arguments.delay_ms:
                cases.append(case(hosts, Quality(loss / 100, delay / 1e3), arguments.seconds))
        if arguments.cut:
            cases.append(case(hosts, Quality(0.0, 0.02), arguments.seconds, CUT_S))
    arguments.out.write_text(json.dumps(cases, indent=1) + "\n")
    print(table(cases))


if __name__ == "__main__":
    main()
