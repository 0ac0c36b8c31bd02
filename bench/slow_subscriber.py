"""Whether one bad subscriber harms the others: latency of ordinary ones without it and with it, in turns.

`python -m bench.slow_subscriber` runs a router, a robot's and a LiDAR's messages, an ordinary subscriber, and one bad one
that subscribes to all of it: none, `frozen` (stopped by a signal), `callback` (takes ten times too long for each message),
`link` (on a link with a tenth of the bandwidth it needs, without shared memory, like a viewer over radio).
"""

from __future__ import annotations

import argparse
import json
import signal
import statistics
import subprocess
import sys
import threading
import time
from collections import defaultdict
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from bench.load_roles import SPEAKERS
from bench.slow_link import slow_link
from shared.messaging.bus import is_reachable

KINDS = ("none", "frozen", "callback", "link")
_LINK_BYTES_PER_S = int(__import__("os").environ.get("X_LINK", "2600000"))
"""A tenth of the messages' 26 MB/s."""
_SETTLE_S = 2.0


class Role:
    """A process of `bench.load_roles`."""

    def __init__(self, role: str, endpoint: str, seconds: float, *arguments: str) -> None:
        command = [sys.executable, "-m", "bench.load_roles", role, "--endpoint", endpoint, "--seconds", str(seconds)]
        self.process = subprocess.Popen(
            [*command, *arguments], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        assert self.process.stdout is not None
        assert self.process.stdout.readline() == "ready\n", f"{role} did not start"

    def begin(self) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write("begin\n")
        self.process.stdin.flush()

    def result(self) -> dict[str, object]:
        assert self.process.stdout is not None
        return json.loads(self.process.stdout.readline())

    def __enter__(self) -> Role:
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.communicate()


def measure(kind: str, endpoint: str, seconds: float) -> dict[str, dict[str, object]]:
    """Latencies and misses of the ordinary subscriber, by key, beside one bad subscriber."""
    with ExitStack() as stack:
        router = subprocess.Popen([sys.executable, "-m", "cli.main", "router", "--endpoint", endpoint])
        stack.callback(router.wait)
        stack.callback(router.terminate)
        while not is_reachable(endpoint):
            time.sleep(0.05)
        speakers = [stack.enter_context(Role(role, endpoint, seconds + _SETTLE_S)) for role in SPEAKERS]
        listener = stack.enter_context(
            Role("listener", endpoint, seconds + _SETTLE_S + 0.5, *__import__("os").environ.get("X_L", "").split())
        )
        bad = None
        if kind == "link":
            slow_endpoint = stack.enter_context(slow_link(endpoint, _LINK_BYTES_PER_S))
            stack.enter_context(Role("bystander", slow_endpoint, seconds, "--shared-memory-mib", "0"))
        elif kind == "frozen_remote":
            bad = stack.enter_context(Role("bystander", endpoint, seconds, "--shared-memory-mib", "0"))
        elif kind != "none":
            bad = stack.enter_context(Role("sleeper" if kind == "callback" else "bystander", endpoint, seconds))
        for role in (listener, *speakers):
            role.begin()
        time.sleep(_SETTLE_S)
        if kind.startswith("frozen"):
            assert bad is not None
            bad.process.send_signal(signal.SIGSTOP)
        result = listener.result()
        for speaker in speakers:
            print(kind, speaker.result(), file=sys.stderr)
        return result
