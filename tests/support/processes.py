"""Real processes for the end-to-end tests: the production commands on a free loopback port."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil

from shared.messaging.bus import Bus
from shared.runtime.config import BusConfig

ROOT = Path(__file__).parents[2]
BIN = Path(sys.executable).parent
STOP_TIMEOUT_S = 30.0


def free_endpoint() -> str:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return f"tcp/127.0.0.1:{server.getsockname()[1]}"


def wait_until(predicate: Callable[[], Any], what: str, deadline_s: float = 60.0) -> Any:
    """The first true value of the predicate; fails with `what` after the deadline."""
    deadline = time.monotonic() + deadline_s
    while time.monotonic() < deadline:
        if value := predicate():
            return value
        time.sleep(0.05)
    raise AssertionError(f"not within {deadline_s:g} s: {what}")


def run(
    *command: str | Path, timeout_s: float = 120.0, cwd: Path = ROOT, stdin: str = ""
) -> subprocess.CompletedProcess[str]:
    """A command run to its end, output as text. `hyrecro`, `zenoh` and `rerun` are those of this environment."""
    name, *arguments = map(str, command)
    path = BIN / name
    return subprocess.run(
        [path if path.exists() else name, *arguments],
        input=stdin,
        capture_output=True,
        text=True,
        timeout=timeout_s,
        cwd=cwd,
        check=False,
    )


@dataclass
class Running:
    """A process under test and where it talks."""

    process: subprocess.Popen[str]
    endpoint: str
    directory: Path

    def stop(self, signum: int = signal.SIGINT) -> int:
        if self.process.poll() is None:
            self.process.send_signal(signum)
        return self.process.wait(STOP_TIMEOUT_S)

    def bus(self) -> Bus:
        return Bus(BusConfig(endpoint=self.endpoint))

    def hyrecro(self, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
        return run("hyrecro", *arguments, "--set", f"bus.endpoint={self.endpoint}")

    def zenoh(self, *arguments: str, stdin: str = "") -> subprocess.CompletedProcess[str]:
        return run("zenoh", "--mode", "client", "--connect", self.endpoint, *arguments, stdin=stdin)

    def state(self) -> dict[str, Any]:
        state: dict[str, Any] = json.loads(self.hyrecro("robot", "state", "--json").stdout)
        return state

    def children(self) -> list[psutil.Process]:
        return psutil.Process(self.process.pid).children(recursive=True)


@contextmanager
def started(command: list[str | Path], directory: Path, endpoint: str | None = None) -> Iterator[Running]:
    """A process with its bus on a free port and its recordings in `directory`; killed if the test leaves it running."""
    endpoint = endpoint or free_endpoint()
    directory.mkdir(parents=True, exist_ok=True)
    options = ["--set", f"bus.endpoint={endpoint}", "--set", f"recorder.directory={directory}"]
    with (directory / "stderr.txt").open("w") as stderr:
        process = subprocess.Popen(
            [*map(str, command), *options],
            stderr=stderr,
            stdout=subprocess.DEVNULL,
            text=True,
            cwd=ROOT,
            env={**os.environ, "PYTHONFAULTHANDLER": "1"},
        )
    running = Running(process, endpoint, directory)
    children: list[psutil.Process] = []
    try:
        yield running
    finally:
        if process.poll() is None:
            children = running.children()
            running.stop(signal.SIGTERM)
        for child in children:
            if child.is_running():
                child.kill()


def hyrecro_command(*arguments: str | Path) -> list[str | Path]:
    return [BIN / "hyrecro", *arguments]


def service_command(module: str, *arguments: str) -> list[str | Path]:
    return [sys.executable, "-m", module, *arguments]
