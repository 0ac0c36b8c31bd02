"""Listens on one host: how often each key came and how long nothing came, and how quickly the robot answers.

`python -m bench.hosts.probe --endpoint E` prints a line of JSON for each line on stdin: what came since the last.
"""

from __future__ import annotations

import argparse
import itertools
import json
import sys
import threading
import time
from collections import defaultdict

from shared.errors import BusError, RefusedError
from shared.messaging.bus import Bus
from shared.messaging.channels import (
    JOINTS_STATE,
    LEG_STATE,
    LEG_TARGET,
    LIDAR_POINTS,
    MAP_ODOMETRY,
    MAP_STATUS,
    TF,
)
from shared.messaging.inbox import Inbox
from shared.messaging.messages import Foot, LegState, LegTarget
from shared.runtime.config import BusConfig

CHANNELS = (JOINTS_STATE, TF, LEG_STATE, LIDAR_POINTS, MAP_ODOMETRY, MAP_STATUS)
_COMMAND_PERIOD_S = 0.5


class Probe:
    """Counts what comes; asks the robot for the foot it stands on again and again, which changes nothing."""

    def __init__(self, bus: Bus) -> None:
        self._bus, self._inbox = bus, Inbox(max_bytes=256 * 1024 * 1024)
        self._lock = threading.Lock()
        self._times_s: dict[str, list[float]] = defaultdict(list)
        self._answers_s: list[float] = []
        self._num_unanswered = 0
        for channel in CHANNELS:
            bus.subscribe(channel, self._inbox)

    def listen(self) -> None:
        """Takes what comes, without end."""
        while True:
            if (parcel := self._inbox.take(1.0)) is not None:
                with self._lock:
                    self._times_s[parcel.channel.key].append(parcel.received_ns * 1e-9)

    def command(self) -> None:
        """Commands, without end. A refusal is an answer: the robot stands on both feet, or on the other."""
        while True:
            started_s = time.monotonic()
            with self._lock:
                self._num_unanswered += 1
            try:
                self._bus.command(LEG_TARGET, LegTarget(foot=Foot.A), timeout_s=2.0)
            except RefusedError:
                pass
            except BusError:
                continue
            with self._lock:
                self._num_unanswered -= 1
                self._answers_s.append(time.monotonic() - started_s)
            time.sleep(_COMMAND_PERIOD_S)

    def report(self, since_s: float) -> dict[str, object]:
        """Since then, and forgets it. longest_gap_s: in which nothing came, by key."""
        now_s = time.monotonic()
        with self._lock:
            gaps_s = {}
            for channel in CHANNELS:
                times_s = [since_s, *self._times_s[channel.key], now_s]
                gaps_s[channel.key] = round(max(b - a for a, b in itertools.pairwise(times_s)), 3)
            report = {
                "seconds": round(now_s - since_s, 3),
                "num_received": {key: len(times) for key, times in self._times_s.items()},
                "longest_gap_s": gaps_s,
                "answers_ms": [round(1e3 * answer_s, 1) for answer_s in self._answers_s],
                "num_unanswered": self._num_unanswered,
            }
            self._times_s.clear()
            self._answers_s, self._num_unanswered = [], 0
        return report


def main() -> None:
    """Reports until stdin ends."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--endpoint", required=True)
    parser.add_argument("--commands", action="store_true", help="ask the robot, too")
    arguments = parser.parse_args()
    with Bus(BusConfig(endpoint=arguments.endpoint)) as bus:
        while bus.ask(LEG_STATE, LegState) is None:
            time.sleep(0.1)
        probe = Probe(bus)
        threading.Thread(target=probe.listen, daemon=True).start()
        if arguments.commands:
            threading.Thread(target=probe.command, daemon=True).start()
        print("ready", flush=True)
        since_s = time.monotonic()
        for _ in sys.stdin:
            print(json.dumps(probe.report(since_s)), flush=True)
            since_s = time.monotonic()


if __name__ == "__main__":
    main()
