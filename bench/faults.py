"""Kills and freezes processes of a pipeline at random moments while it climbs, and looks at what becomes of the run.

`python -m bench.faults --kills 50` plays the climb on a pipeline of `hyrecro up`. In turn, in an order and at moments
drawn by the seed, each process gets SIGKILL or SIGSTOP; it is measured how long it takes until every process is alive
and scans, poses and joint states flow again. In the end the recording is read: see `faults_scoring`.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import random
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import psutil

from bench.faults_scoring import RunScore, score_of
from shared.errors import HyrecroError
from shared.messaging.bus import Bus
from shared.messaging.channels import JOINTS_STATE, LIDAR_POINTS, MAP_ODOMETRY
from shared.messaging.inbox import Inbox
from shared.runtime.config import CONFIGS_DIR, BusConfig

VICTIMS = {
    "router": "cli.main router",
    "sim": "services.sim",
    "lidar": "services.sensors --sensor lidar",
    "depth": "services.sensors --sensor depth",
    "mapper": "services.mapper",
    "evaluator": "services.evaluator",
    "planner": "services.planner",
    "recorder": "services.recorder",
}
SERVICES = frozenset(VICTIMS) - {"router"}
FLOWS = (JOINTS_STATE, LIDAR_POINTS, MAP_ODOMETRY)
_FREEZE_SHARE = 0.2
_PAUSE_S = (0.5, 2.5)
"""Between being whole and the next kill."""
_A_KILL_S = 7.0
"""About how long one takes with its pause: the climb is made so slow that it outlasts all of them."""
_ROWS, _RATE_HZ = 41, 9.0
_START_TIMEOUT_S, _WHOLE_TIMEOUT_S, _CLIMB_TIMEOUT_S = 120.0, 60.0, 1800.0


@dataclass(frozen=True, slots=True)
class Kill:
    """whole_s: from the signal until all processes were alive and everything flowed."""

    victim: str
    signal: str
    at_s: float
    whole_s: float


class Pipeline:
    """`hyrecro up` as a child, and what is seen of it from the bus and from the table of processes."""

    def __init__(self, folder: Path, endpoint: str) -> None:
        self._options = [f"bus.endpoint={endpoint}", f"recorder.directory={folder}", "recorder.run=faults"]
        self.up = self._hyrecro("up", log=folder / "up.log")
        self._bus_config = BusConfig(endpoint=endpoint, connect_timeout_s=_START_TIMEOUT_S)
        self._inbox = Inbox()

    def play(self, num_steps: int, log: Path) -> subprocess.Popen[bytes]:
        """The climb."""
        trajectory = str(CONFIGS_DIR / "trajectories" / "climb.csv")
        return self._hyrecro("robot", "play", trajectory, "--rate", f"{_RATE_HZ}", "--steps", f"{num_steps}", log=log)

    @contextlib.contextmanager
    def watched(self) -> Iterator[None]:
        """Hears what flows."""
        with Bus(self._bus_config) as self._bus:
            for channel in FLOWS:
                self._bus.subscribe(channel, self._inbox)
            yield

    def alive(self) -> set[str]:
        """The services that are ready, as the router knows."""
        return self._bus.alive()

    def victim(self, name: str) -> psutil.Process:
        """The process of that name that runs now."""
        for child in psutil.Process(self.up.pid).children(recursive=True):
            with contextlib.suppress(psutil.NoSuchProcess, psutil.ZombieProcess):
                if f"-m {VICTIMS[name]}" in " ".join(child.cmdline()):
                    return child
        raise HyrecroError(f"{name} does not run")

    def wait_until_whole(self, begun_s: float, timeout_s: float, what: str) -> float:
        """Seconds from `begun_s` until all services are alive and of each flow two messages came after that."""
        deadline_s = time.monotonic() + timeout_s
        while not self._bus.alive() >= SERVICES:
            self._check(deadline_s, what)
            time.sleep(0.02)
        while self._inbox.take(0.0) is not None:
            pass
        num_heard = dict.fromkeys((channel.key_expr for channel in FLOWS), 0)
        while min(num_heard.values()) < 2:
            self._check(deadline_s, f"{what}; heard {num_heard}")
            if (parcel := self._inbox.take(0.1)) is not None:
                num_heard[parcel.key] += 1
        return time.monotonic() - begun_s

    def _check(self, deadline_s: float, what: str) -> None:
        if self.up.poll() is not None:
            raise HyrecroError(f"hyrecro up ended with {self.up.returncode}: {what}")
        if time.monotonic() > deadline_s:
            raise HyrecroError(f"not whole again: {what}")

    def _hyrecro(self, *arguments: str, log: Path) -> subprocess.Popen[bytes]:
        options = [part for option in self._options for part in ("--set", option)]
        with log.open("wb") as output:
            return subprocess.Popen(  # noqa: S603 - our own modules
                [sys.executable, "-m", "cli.main", *arguments, *options], stdout=output, stderr=output
            )


def kill_once(pipeline: Pipeline, name: str, signum: signal.Signals, begun_s: float) -> Kill:
    """Sends the signal, and waits until another process of that name does its work and all is whole."""
    process = pipeline.victim(name)
    killed_s = time.monotonic()
    process.send_signal(signum)
    what = f"{name} after {signum.name}"
    _wait_for(lambda: not _is_running(process), _WHOLE_TIMEOUT_S, f"the end of {what}")
    _wait_for(lambda: name not in pipeline.alive(), _WHOLE_TIMEOUT_S, f"everyone knowing of the end of {what}")
    whole_s = pipeline.wait_until_whole(killed_s, _WHOLE_TIMEOUT_S, what)
    return Kill(name, signum.name, round(killed_s - begun_s, 3), round(whole_s, 3))


def campaign(folder: Path, num_kills: int, seed: int) -> tuple[list[Kill], int, float]:
    """The kills, the exit code of the climb, and how long it took. All victims in turn, each turn in another order."""
    rng = random.Random(seed)  # noqa: S311 - moments, not secrets
    with socket.create_server(("127.0.0.1", 0)) as server:
        endpoint = f"tcp/127.0.0.1:{server.getsockname()[1]}"
    pipeline = Pipeline(folder, endpoint)
    play = None
    try:
        with pipeline.watched():
            pipeline.wait_until_whole(time.monotonic(), _START_TIMEOUT_S, "the start")
            num_steps = max(10, round(num_kills * _A_KILL_S * _RATE_HZ / _ROWS))
            play, begun_s = pipeline.play(num_steps, folder / "play.log"), time.monotonic()
            kills: list[Kill] = []
            order: list[str] = []
            for _ in range(num_kills):
                order = order or rng.sample(sorted(VICTIMS), len(VICTIMS))
                signum = signal.SIGSTOP if rng.random() < _FREEZE_SHARE else signal.SIGKILL
                time.sleep(rng.uniform(*_PAUSE_S))
                kills.append(kill_once(pipeline, order.pop(), signum, begun_s))
                print(f"{len(kills)}/{num_kills} {kills[-1]}", file=sys.stderr)
            exit_code = play.wait(_CLIMB_TIMEOUT_S)
            climb_s = time.monotonic() - begun_s
            time.sleep(1.0)  # for the last scans
            return kills, exit_code, climb_s
    finally:
        for process in (play, pipeline.up):
            if process is not None and process.poll() is None:
                process.terminate()
                process.wait(60)


def _is_running(process: psutil.Process) -> bool:
    try:
        return process.is_running() and process.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def _wait_for(is_so: Callable[[], bool], timeout_s: float, what: str) -> None:
    deadline_s = time.monotonic() + timeout_s
    while not is_so():
        if time.monotonic() > deadline_s:
            raise HyrecroError(f"not within {timeout_s:g} s: {what}")
        time.sleep(0.01)


def as_table(kills: list[Kill], exit_code: int, climb_s: float, score: RunScore) -> str:
    """For docs/benchmarks."""
    lines = ["| process | kills | frozen | whole again, median s | longest s |", "|---|---|---|---|---|"]
    for name in [*VICTIMS, "all"]:
        some = [kill for kill in kills if name in (kill.victim, "all")]
        if some:
            times, num_frozen = [kill.whole_s for kill in some], sum(kill.signal == "SIGSTOP" for kill in some)
            longest, median = max(times), statistics.median(times)
            lines.append(f"| {name} | {len(some)} | {num_frozen} | {median:.1f} | {longest:.1f} |")
    figures = {
        "the climb": f"played to its end in {climb_s:.0f} s" if exit_code == 0 else f"ended with {exit_code}",
        "trajectory, ATE RMSE": f"{score.ate_rmse_m * 1000:.2f} mm over {score.num_poses} poses",
        "trajectory, largest error": f"{score.ate_max_m * 1000:.2f} mm",
        "scans without tracking": score.num_untracked,
        "files of the recording": score.num_files,
        "messages in them": score.num_messages,
        "messages missing": score.num_missing,
        "topics whose counts do not balance": len(score.unbalanced),
        "restored": ", ".join(f"{name} {num}" for name, num in sorted(score.restored.items())),
    }
    return "\n".join([*lines, "", "| of the run | |", "|---|---|", *(f"| {k} | {v} |" for k, v in figures.items())])


def main() -> None:
    """Prints a table; --json FILE keeps all figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--keep", type=Path, help="folder for recording and logs; default: none is left")
    arguments = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # so that the pipeline is ended, too
    with tempfile.TemporaryDirectory() as name:
        folder = arguments.keep or Path(name)
        folder.mkdir(parents=True, exist_ok=True)
        kills, exit_code, climb_s = campaign(folder, arguments.kills, arguments.seed)
        score = score_of(folder / "faults")
    if arguments.json is not None:
        figures = {"kills": [asdict(kill) for kill in kills], "exit_code": exit_code, "climb_s": round(climb_s, 1)}
        arguments.json.write_text(json.dumps(figures | {"run": asdict(score)}, indent=1) + "\n")
    print(as_table(kills, exit_code, climb_s, score))
    is_fine = exit_code == 0 and not score.unbalanced
    sys.exit(os.EX_OK if is_fine else 1)


if __name__ == "__main__":
    main()
