"""`python -m bench.hosts.line`: the whole line over two hosts, split as docker-compose.hosts.yml does, and a climb.

Simulation, sensors, mapper and planner run on the robot, recorder and evaluator on the base, a router on each. The base
plays the beginning of the climb over a link that delays, loses and is cut. See `line_scoring` for what is looked at.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import IO, Any, cast

from bench.hosts.line_scoring import Cut, scored, table
from bench.hosts.network import ADDRESSES, Network, network, on_host
from bench.hosts.wire import Quality
from shared.errors import HyrecroError
from shared.runtime.config import CONFIGS_DIR

ENDPOINTS = {host: f"tcp/{address}:7447" for host, address in ADDRESSES.items()}
SENSORS = ("lidar", "depth")
SERVICES = {"base": ("recorder", "evaluator"), "robot": ("mapper", *SENSORS, "planner", "sim")}
"""In the order in which they start: who listens before who speaks."""
NUM_ROWS = 5
"""Of the climb: with a change of foot, 6.6 s of simulated time."""
CUT_AFTER_S, QUIET_S = 8.0, 3.0
_LISTENER = "bench.hosts.listener"
_START_TIMEOUT_S, _PLAY_TIMEOUT_S, _DRAIN_TIMEOUT_S, _STOP_TIMEOUT_S = 180.0, 300.0, 60.0, 30.0


class Line:
    """The processes of both hosts. channels: patterns of what recorder and listener of the base subscribe to.

    folder: gets the recording, `robot.jsonl` and `base.jsonl` of the listeners, and a log of each process.
    """

    def __init__(self, stack: contextlib.ExitStack, folder: Path, settings: list[str], channels: list[str]) -> None:
        self._stack, self._folder = stack, folder
        self._settings = [*settings, f"recorder.channels={json.dumps(channels)}"]
        self._services: dict[str, list[subprocess.Popen[str]]] = {host: [] for host in SERVICES}
        robot, base = ENDPOINTS["robot"], ENDPOINTS["base"]
        self._start("robot", "router_robot", "cli.main", "router", "--endpoint", robot)
        self._start("base", "router_base", "cli.main", "router", "--endpoint", base, "--connect", robot)
        self._listeners = {
            host: self._start(host, f"listener_{host}", _LISTENER, ENDPOINTS[host], f"{folder / host}.jsonl", *patterns)
            for host, patterns in (("robot", ["*"]), ("base", channels))
        }
        for listener in self._listeners.values():
            cast(IO[str], listener.stdout).readline()

    def start(self) -> None:
        """Returns when all are ready."""
        for host, names in SERVICES.items():
            for name in names:
                module = ["services.sensors", "--sensor", name] if name in SENSORS else [f"services.{name}"]
                if name == "sim":
                    self.wait_for_ready([*SERVICES["base"], *names[:-1]])
                self._services[host].append(self._start(host, name, *module, *self._options(host)))
        self.wait_for_ready([name for names in SERVICES.values() for name in names])

    def play(self, trajectory: Path) -> subprocess.Popen[str]:
        """`hyrecro robot play` on the base."""
        return self._start(
            "base", "player", "cli.main", "robot", "play", f"{trajectory}", "--speed", "0.3", *self._options("base")
        )

    def stop(self) -> None:
        """The robot first; the base when nothing of it comes any more."""
        _end(reversed(self._services["robot"]))
        num_heard, deadline_s = -1, time.monotonic() + _DRAIN_TIMEOUT_S
        while (now := self._asked("base")["num_of_robot"]) != num_heard and time.monotonic() < deadline_s:
            num_heard = now
            time.sleep(QUIET_S)
        _end(reversed(self._services["base"]))
        for listener in self._listeners.values():
            cast(IO[str], listener.stdin).close()
            listener.wait(_STOP_TIMEOUT_S)

    def _asked(self, host: str) -> dict[str, Any]:
        commands, answers = self._listeners[host].stdin, self._listeners[host].stdout
        cast(IO[str], commands).write("\n")
        cast(IO[str], commands).flush()
        answer: dict[str, Any] = json.loads(cast(IO[str], answers).readline())
        return answer

    def wait_for_ready(self, names: list[str]) -> None:
        """As the base sees it."""
        _wait_for(lambda: set(names) <= set(self._asked("base")["alive"]), f"ready: {', '.join(names)}")

    def _options(self, host: str) -> list[str]:
        settings = [f"bus.endpoint={ENDPOINTS[host]}", "bus.connect_timeout_s=60", "bus.shared_memory_mib=0"]
        settings += [f"recorder.directory={self._folder}", "recorder.run=run", *self._settings]
        return [part for setting in settings for part in ("--set", setting)]

    def _start(self, host: str, log_name: str, *module: str) -> subprocess.Popen[str]:
        with (self._folder / f"{log_name}.log").open("w") as log:
            process = subprocess.Popen(  # noqa: S603 - our own modules
                on_host(host, sys.executable, "-m", *module),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE if _LISTENER in module else log,
                stderr=log,
                text=True,
            )
        self._stack.callback(lambda: _end([process]))
        return process


def case(quality: Quality, cut_s: float, folder: Path, settings: list[str], channels: list[str]) -> dict[str, Any]:
    """One climb from the start of all services to their end."""
    trajectory = folder / "climb.csv"
    rows = (CONFIGS_DIR / "trajectories" / "climb.csv").read_text().splitlines()
    trajectory.write_text("\n".join(rows[: NUM_ROWS + 1]) + "\n")
    with network() as wire, contextlib.ExitStack() as stack:
        wire.set_quality(quality)
        line = Line(stack, folder, settings, channels)
        line.start()
        wire.set_quality(quality)
        began_ns = time.monotonic_ns()
        player = line.play(trajectory)
        line.wait_for_ready(["player"])
        cut = _cut(wire, quality, cut_s) if cut_s else None
        _wait_for(lambda: player.poll() is not None, "the end of the climb", _PLAY_TIMEOUT_S)
        ended_ns = time.monotonic_ns()
        num_bytes = wire.set_quality(quality).get("num_bytes", 0)
        line.stop()
    return {
        "loss": quality.loss,
        "delay_s": quality.delay_s,
        "cut_s": cut_s,
        "settings": settings,
        "channels": channels,
        "load": round(os.getloadavg()[0], 1),
        "exit_code": player.returncode,
        "climb_s": round((ended_ns - began_ns) * 1e-9, 1),
        "mbit_per_s": round(num_bytes * 8e3 / (ended_ns - began_ns), 2),
        **scored(folder, began_ns, ended_ns, cut),
    }


def _cut(wire: Network, quality: Quality, cut_s: float) -> Cut:
    time.sleep(CUT_AFTER_S)
    wire.set_quality(Quality(quality.loss, quality.delay_s, is_cut=True))
    began_ns = time.monotonic_ns()
    time.sleep(cut_s)
    wire.set_quality(quality)
    return Cut(began_ns, time.monotonic_ns())


def _wait_for(is_so: Callable[[], bool], what: str, timeout_s: float = _START_TIMEOUT_S) -> None:
    deadline_s = time.monotonic() + timeout_s
    while not is_so():
        if time.monotonic() > deadline_s:
            raise HyrecroError(f"not within {timeout_s:g} s: {what}")
        time.sleep(0.2)


def _end(processes: Iterable[subprocess.Popen[str]]) -> None:
    for process in processes:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
            process.wait(_STOP_TIMEOUT_S)


def main() -> None:
    """Runs one case, adds it to a JSON file, and prints all that are there."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("docs/benchmarks/hosts_line.json"))
    parser.add_argument("--loss-percent", type=float, default=0.0)
    parser.add_argument("--delay-ms", type=float, default=0.0)
    parser.add_argument("--cut-s", type=float, default=0.0)
    parser.add_argument("--pace", type=float, default=0.2, help="seconds of simulated time a second")
    parser.add_argument("--set", action="append", default=[], help="a setting of all services")
    parser.add_argument("--channels", nargs="*", default=["*"], help="recorder.channels")
    parser.add_argument("--keep", type=Path, help="folder for recording and logs; default: none is left")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = (arguments.keep or Path(name)).resolve()
        folder.mkdir(parents=True, exist_ok=True)
        settings = [f"sim.real_time_factor={arguments.pace}", *arguments.set]
        quality = Quality(arguments.loss_percent / 100, arguments.delay_ms / 1e3)
        figures = case(quality, arguments.cut_s, folder, settings, arguments.channels)
    cases = [*(json.loads(arguments.out.read_text()) if arguments.out.exists() else []), figures]
    arguments.out.write_text(json.dumps(cases, indent=1) + "\n")
    print(table(cases))


if __name__ == "__main__":
    main()
