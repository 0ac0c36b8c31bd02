"""`python -m bench.hosts`: a robot's host and a base, a router on each, over a link that delays, loses and is cut.

On the robot's host: simulation, LiDAR, mapper, planner. On the base: recorder, evaluator, an operator who commands.
Each case is a recording of its own, whose counts say what was published, came, and was lost. Needs root.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any, cast

from mcap.reader import make_reader

from bench.hosts.network import ADDRESSES, Network, network, on_host
from bench.hosts.wire import Quality
from shared.runtime.exit_codes import Exit

PORT = 7447
SERVICES = {"base": ("recorder", "evaluator"), "robot": ("mapper", "planner", "sensors", "sim")}
SETTINGS = ("recorder.starts=false", "sensors.depth.enabled=false")
KEYS = ("joints/state", "tf", "leg/state", "lidar/points", "map/odometry", "map/status")
CUT_S, AFTER_CUT_S = 10.0, 20.0


class Probe:
    """A `bench.hosts.probe` on one host."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process
        cast(IO[str], process.stdout).readline()

    def report(self) -> dict[str, Any]:
        """What came since the last report."""
        commands = cast(IO[str], self._process.stdin)
        commands.write("\n")
        commands.flush()
        report: dict[str, Any] = json.loads(cast(IO[str], self._process.stdout).readline())
        return report


class Hosts:
    """Both hosts with everything running."""

    def __init__(self, wire: Network, stack: contextlib.ExitStack, folder: Path) -> None:
        self.wire, self._stack, self.folder = wire, stack, folder
        self._start("robot", "cli.main", "router", "--endpoint", _endpoint("robot"))
        self._start("base", "cli.main", "router", "--endpoint", _endpoint("base"), "--connect", _endpoint("robot"))
        settings = [*SETTINGS, f"recorder.directory={folder}"]
        for host, services in SERVICES.items():
            for service in services:
                arguments = [f"services.{service}", "--set", f"bus.endpoint={_endpoint(host)}"]
                self._start(host, *arguments, *(part for setting in settings for part in ("--set", setting)))
        self.probes = {
            host: Probe(self._start(host, "bench.hosts.probe", "--endpoint", _endpoint(host), *more))
            for host, more in (("robot", ()), ("base", ("--commands",)))
        }

    def record(self, *arguments: str) -> None:
        """`hyrecro record ...` on the base; 3 of a stop says that the recording lacks something."""
        command = ["-m", "cli.main", "record", *arguments, "--set", f"bus.endpoint={_endpoint('base')}"]
        done = subprocess.run(on_host("base", sys.executable, *command), stdout=subprocess.DEVNULL, check=False)  # noqa: S603
        if done.returncode not in (Exit.FINE, Exit.PARTIAL):
            raise SystemExit(f"hyrecro record {arguments[0]} ended with {done.returncode}")

    def _start(self, host: str, *module: str) -> subprocess.Popen[str]:
        log = self._stack.enter_context((self.folder / f"{host}_{module[0]}.log").open("w"))
        process = subprocess.Popen(  # noqa: S603 - our own modules
            on_host(host, sys.executable, "-m", *module),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=log,
            text=True,
        )
        self._stack.callback(_end, process)
        return process


@contextlib.contextmanager
def hosts() -> Iterator[Hosts]:
    """Starts everything, and ends it."""
    with tempfile.TemporaryDirectory() as folder, network() as wire, contextlib.ExitStack() as stack:
        running = Hosts(wire, stack, Path(folder))
        time.sleep(5.0)  # mapper and evaluator have begun, the first scans were taken
        yield running


def case(running: Hosts, name: str, quality: Quality, seconds: float, cut_s: float = 0.0) -> dict[str, Any]:
    """Records for so long over a link of this quality, which is cut after a third of it if `cut_s` says so."""
    print(f"{name} ...", file=sys.stderr)
    running.wire.set_quality(quality)
    time.sleep(2.0)
    running.record("start", "--run", name)
    running.wire.set_quality(quality)
    for probe in running.probes.values():
        probe.report()
    began_s = time.monotonic()
    if cut_s:
        time.sleep(seconds / 3)
        running.wire.set_quality(Quality(quality.loss, quality.delay_s, is_cut=True))
        time.sleep(cut_s)
        running.wire.set_quality(quality)
        time.sleep(seconds * 2 / 3)
    else:
        time.sleep(seconds)
    elapsed_s = time.monotonic() - began_s
    carried = running.wire.set_quality(quality)
    reports = {host: probe.report() for host, probe in running.probes.items()}
    running.wire.set_quality(Quality())
    time.sleep(1.0)
    running.record("stop")
    answers_ms = reports["base"]["answers_ms"]
    return {
        "name": name,
        "loss": quality.loss,
        "delay_ms": 1e3 * quality.delay_s,
        "cut_s": cut_s,
        "seconds": round(elapsed_s, 1),
        "mbit_per_s": round(carried.get("num_bytes", 0) * 8e-6 / elapsed_s, 2),
        "packets_lost": carried.get("num_lost", 0),
        "counts": _counts(running.folder / name / "run.mcap"),
        "robot": {key: reports["robot"][key] for key in ("num_received", "longest_gap_s")},
        "base": {key: reports["base"][key] for key in ("num_received", "longest_gap_s", "num_unanswered")},
        "answer_ms": round(statistics.median(answers_ms), 1) if answers_ms else None,
        "slowest_answer_ms": max(answers_ms, default=None),
        "num_answers": len(answers_ms),
    }


def _counts(path: Path) -> dict[str, dict[str, int]]:
    with path.open("rb") as file:
        counts = next(
            record.metadata for record in make_reader(file).iter_metadata() if record.name == "hyrecro_counts"
        )
    return {key: json.loads(counts[f"/{key}"]) for key in KEYS if f"/{key}" in counts}


def _endpoint(host: str) -> str:
    return f"tcp/{ADDRESSES[host]}:{PORT}"


def _end(process: subprocess.Popen[str]) -> None:
    process.terminate()
    try:
        process.wait(10.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def main() -> None:
    """Runs the cases that are asked for and puts them into a JSON file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("docs/benchmarks/hosts.json"))
    parser.add_argument("--seconds", type=float, default=15.0, help="of each case")
    parser.add_argument("--loss-percent", type=float, nargs="*", default=[0, 1, 5])
    parser.add_argument("--delay-ms", type=float, nargs="*", default=[0, 20, 100])
    parser.add_argument("--cut", action="store_true", help="also with a cut of 10 s")
    arguments = parser.parse_args()
    results = json.loads(arguments.out.read_text()) if arguments.out.exists() else {}
    with hosts() as running:
        for loss in arguments.loss_percent:
            for delay in arguments.delay_ms:
                name = f"loss_{loss:g}_delay_{delay:g}"
                results[name] = case(running, name, Quality(loss / 100, delay / 1e3), arguments.seconds)
        if arguments.cut:
            results["cut"] = case(running, "cut", Quality(0.0, 0.02), 1.5 * AFTER_CUT_S, CUT_S)
    arguments.out.write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
