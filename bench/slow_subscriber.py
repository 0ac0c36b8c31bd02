"""Whether one bad subscriber harms the others: latency of an ordinary one without it and with it, in turns.

`python -m bench.slow_subscriber` runs a router, what the robot, its LiDAR and its camera say, an ordinary subscriber,
and beside it a bad one that subscribes to all of it:

none      no bad one
good      one that keeps up, for what one more costs
frozen    stopped by a signal when it has begun to take messages through shared memory
stuck     the same without shared memory, as on another host
callback  takes ten times as long for each message as there is between two of them
link      on a link with a tenth of the bandwidth it needs, without shared memory, as a viewer over radio
"""

from __future__ import annotations

import argparse
import json
import signal
import socket
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bench.load_roles import SETTLE_S, SPEAKERS
from bench.slow_link import slow_link
from shared.messaging.bus import is_reachable

_LINK_BYTES_PER_S = 2_600_000
"""A tenth of what is said."""
_NO_SHARED_MEMORY = ("--shared-memory-mib", "0")
_START_S = 60.0


class Role:
    """A process of `bench.load_roles`, ready to begin."""

    def __init__(self, role: str, endpoint: str, seconds: float, *arguments: str) -> None:
        command = [sys.executable, "-m", "bench.load_roles", role, "--endpoint", endpoint, "--seconds", str(seconds)]
        self.process = subprocess.Popen(  # noqa: S603 - our own module
            [*command, *arguments], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        if self._line() != "ready\n":
            raise RuntimeError(f"{role} did not start")

    def begin(self) -> None:
        """Lets it publish or listen."""
        assert self.process.stdin is not None
        self.process.stdin.write("begin\n")
        self.process.stdin.flush()

    def result(self) -> Any:
        """Its figures, when it has finished."""
        return json.loads(self._line())

    def _line(self) -> str:
        assert self.process.stdout is not None
        return self.process.stdout.readline()

    def __enter__(self) -> Role:
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.communicate()


def _nobody(_stack: ExitStack, _endpoint: str) -> Callable[[], None]:
    return lambda: None


def _good(stack: ExitStack, endpoint: str) -> Callable[[], None]:
    stack.enter_context(Role("bystander", endpoint, 0))
    return lambda: None


def _frozen(*arguments: str) -> Callable[[ExitStack, str], Callable[[], None]]:
    def start(stack: ExitStack, endpoint: str) -> Callable[[], None]:
        role = stack.enter_context(Role("bystander", endpoint, 0, *arguments))
        return lambda: role.process.send_signal(signal.SIGSTOP)

    return start


def _sleeper(stack: ExitStack, endpoint: str) -> Callable[[], None]:
    stack.enter_context(Role("sleeper", endpoint, 0))
    return lambda: None


def _behind_a_slow_link(stack: ExitStack, endpoint: str) -> Callable[[], None]:
    slow_endpoint = stack.enter_context(slow_link(endpoint, _LINK_BYTES_PER_S))
    stack.enter_context(Role("bystander", slow_endpoint, 0, *_NO_SHARED_MEMORY))
    return lambda: None


KINDS: dict[str, Callable[[ExitStack, str], Callable[[], None]]] = {
    "none": _nobody,
    "good": _good,
    "frozen": _frozen(),
    "stuck": _frozen(*_NO_SHARED_MEMORY),
    "callback": _sleeper,
    "link": _behind_a_slow_link,
}
"""Starts the bad subscriber; what is returned spoils it once everything runs."""


def measure(kind: str, seconds: float) -> dict[str, dict[str, Any]]:
    """Latencies and misses of the ordinary subscriber, by key, beside one bad subscriber."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        endpoint = f"tcp/127.0.0.1:{server.getsockname()[1]}"
    with ExitStack() as stack:
        router = subprocess.Popen(  # noqa: S603 - our own command
            [sys.executable, "-m", "cli.main", "router", "--endpoint", endpoint], stderr=subprocess.DEVNULL
        )
        stack.callback(router.wait)
        stack.callback(router.terminate)
        deadline_s = time.monotonic() + _START_S
        while not is_reachable(endpoint):
            if time.monotonic() > deadline_s:
                raise RuntimeError("the router did not start")
            time.sleep(0.05)
        speakers = [stack.enter_context(Role(role, endpoint, seconds + SETTLE_S)) for role in SPEAKERS]
        listener = stack.enter_context(Role("listener", endpoint, seconds + SETTLE_S + 0.5))
        spoil = KINDS[kind](stack, endpoint)
        for role in (listener, *speakers):
            role.begin()
        time.sleep(SETTLE_S)
        spoil()
        figures: dict[str, dict[str, Any]] = listener.result()
        return figures


@dataclass(frozen=True, slots=True)
class Row:
    """One key beside one bad subscriber, over all rounds. p99_ratio: to the run without, median of the rounds."""

    kind: str
    key: str
    num_received: int
    num_missed: int
    p50_ms: float
    p99_ms: float
    p99_least_ms: float
    p99_most_ms: float
    p99_ratio: float


def rows_of(rounds: list[dict[str, dict[str, dict[str, Any]]]]) -> list[Row]:
    """One row a kind and key."""
    rows = []
    for kind in rounds[0]:
        for key in sorted(rounds[0]["none"]):
            of_rounds = [each[kind][key] for each in rounds]
            p99s = [float(np.percentile(each["latency_ms"], 99)) for each in of_rounds]
            p99s_without = [float(np.percentile(each["none"][key]["latency_ms"], 99)) for each in rounds]
            everything = np.concatenate([each["latency_ms"] for each in of_rounds])
            rows.append(
                Row(
                    kind=kind,
                    key=key,
                    num_received=len(everything),
                    num_missed=sum(each["num_missed"] for each in of_rounds),
                    p50_ms=float(np.percentile(everything, 50)),
                    p99_ms=float(np.percentile(everything, 99)),
                    p99_least_ms=min(p99s),
                    p99_most_ms=max(p99s),
                    p99_ratio=statistics.median(a / b for a, b in zip(p99s, p99s_without, strict=True)),
                )
            )
    return rows


def table(rows: list[Row]) -> str:
    """The rows as Markdown."""
    lines = [
        "| bad subscriber | key | received | missed | p50 ms | p99 ms (least .. most of a round) | p99 to none |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        spread = f"{row.p99_ms:.1f} ({row.p99_least_ms:.1f} .. {row.p99_most_ms:.1f})"
        lines.append(
            f"| {row.kind} | {row.key} | {row.num_received} | {row.num_missed} | {row.p50_ms:.2f} | {spread} "
            f"| {row.p99_ratio:.2f} |"
        )
    return "\n".join(lines)


def main() -> None:
    """Measures in turns; the table goes to stdout, rows to a file if asked for."""
    parser = argparse.ArgumentParser(
        prog="python -m bench.slow_subscriber", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=15.0, help="of each run")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS), metavar="KIND")
    parser.add_argument("--out", type=Path, help="rows as JSON")
    arguments = parser.parse_args()
    kinds = dict.fromkeys(["none", *arguments.kinds])
    rounds: list[dict[str, dict[str, dict[str, Any]]]] = []
    for number in range(arguments.rounds):
        figures = {}
        for kind in kinds:
            print(f"round {number + 1} of {arguments.rounds}: {kind}", file=sys.stderr)
            figures[kind] = measure(kind, arguments.seconds)
        rounds.append(figures)
    rows = rows_of(rounds)
    if arguments.out is not None:
        arguments.out.write_text(json.dumps([asdict(row) for row in rows], indent=1) + "\n")
    print(table(rows))


if __name__ == "__main__":
    main()
