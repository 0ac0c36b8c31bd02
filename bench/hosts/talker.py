"""One end of the talk between two hosts: `python -m bench.hosts.talker speak|listen ENDPOINT`.

`speak` is a robot without its arithmetic: a clock at 50 Hz, a leg state and a scan of 4000 points (88 kB) at 10 Hz.
`listen` prints a line of JSON for each line on stdin: by key how many came since the last, of how many, and how late.
"""

from __future__ import annotations

import json
import statistics
import sys
import time
from collections import defaultdict
from dataclasses import replace

import numpy as np

from shared.messaging.bus import Bus
from shared.messaging.channels import CLOCK, LEG_STATE, LIDAR_POINTS
from shared.messaging.codec import decode
from shared.messaging.inbox import Inbox
from shared.messaging.messages import Clock, Foot, LegState, LidarScan, Measurement
from shared.runtime.config import BusConfig

CHANNELS = (CLOCK, LEG_STATE, LIDAR_POINTS)
PERIOD_S, CLOCKS_A_SCAN, NUM_POINTS = 0.02, 5, 4000


def speak(bus: Bus) -> None:
    """Publishes without end. Stamps are of the monotonic clock, which all hosts of this machine share."""
    identity = np.array([0, 0, 0, 0, 0, 0, 1.0])
    leg = LegState(stamp_ns=0, seq=0, frame="world", fixed_foot=Foot.A, T_world_foot=identity)
    scan = LidarScan(
        stamp_ns=0,
        seq=0,
        frame="lidar",
        points_m=np.random.default_rng(0).random((NUM_POINTS, 3), dtype=np.float32),
        intensity=np.zeros(NUM_POINTS, dtype=np.float32),
        t_ns=np.zeros(NUM_POINTS, dtype=np.uint32),
        ring=np.zeros(NUM_POINTS, dtype=np.uint16),
    )
    for channel in CHANNELS:
        bus.advertise(channel)
    number = 0
    while True:
        begin_s, stamp_ns = time.monotonic(), time.monotonic_ns()
        bus.publish(CLOCK, Clock(stamp_ns=stamp_ns, seq=number, frame=""))
        if number % CLOCKS_A_SCAN == 0:
            bus.publish(LEG_STATE, replace(leg, seq=number // CLOCKS_A_SCAN, stamp_ns=stamp_ns))
            bus.publish(LIDAR_POINTS, replace(scan, seq=number // CLOCKS_A_SCAN, stamp_ns=stamp_ns))
        number += 1
        time.sleep(max(0.0, PERIOD_S - (time.monotonic() - begin_s)))


def listen(bus: Bus) -> None:
    """Reports until stdin ends."""
    inbox = Inbox(max_bytes=256 * 1024 * 1024)
    for channel in CHANNELS:
        bus.subscribe(channel, inbox)
    inbox.take(60.0)
    print("ready", flush=True)
    for _ in sys.stdin:
        print(json.dumps(_report(inbox)), flush=True)


def _report(inbox: Inbox) -> dict[str, dict[str, float]]:
    seqs: defaultdict[str, list[int]] = defaultdict(list)
    late_ms: defaultdict[str, list[float]] = defaultdict(list)
    times_s: defaultdict[str, list[float]] = defaultdict(list)
    while (parcel := inbox.take(0.0)) is not None:
        message = decode(parcel.channel.message, parcel.payload)
        assert isinstance(message, Measurement)
        seqs[parcel.channel.key].append(message.seq)
        late_ms[parcel.channel.key].append((parcel.received_ns - message.stamp_ns) * 1e-6)
        times_s[parcel.channel.key].append(parcel.received_ns * 1e-9)
    return {
        key: {
            "num_received": len(those),
            "num_sent": those[-1] - those[0] + 1,
            "late_p50_ms": round(statistics.median(late_ms[key]), 1),
            "late_max_ms": round(max(late_ms[key]), 1),
            "longest_gap_s": round(float(np.max(np.diff(times_s[key]), initial=0.0)), 2),
        }
        for key, those in seqs.items()
    }


def main() -> None:
    """Speaks or listens."""
    work, endpoint = sys.argv[1:]
    with Bus(BusConfig(endpoint=endpoint, shared_memory_mib=0)) as bus:
        {"speak": speak, "listen": listen}[work](bus)


if __name__ == "__main__":
    main()
