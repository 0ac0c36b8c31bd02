"""The processes of `bench.slow_subscriber`: who publishes as the pipeline does, who listens and measures, who is slow.

Each runs as `python -m bench.load_roles ROLE --endpoint E --seconds S`, says `ready` on a line of its own, begins when
it reads a line, and ends with its figures as one line of JSON. A message's stamp is when it was due, on the monotonic
clock that all processes of a machine share: what a stalled publisher sends late counts as late.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import defaultdict
from dataclasses import replace
from typing import Any

import numpy as np

from bench.recorder_load import Stream
from shared.messaging import channels as c, messages as m
from shared.messaging.bus import Bus
from shared.messaging.codec import decode
from shared.messaging.inbox import Inbox, Parcel
from shared.messaging.sequence import SequenceCounter
from shared.runtime.config import BusConfig

HEARD = (c.JOINTS_STATE, c.LEG_STATE, c.LIDAR_POINTS, c.DEPTH_IMAGE)
"""What the ordinary subscriber measures."""
_NUM_POINTS = 65_536
"""Of the default scan, 128 rings of 512 columns: 1.4 MB."""
SETTLE_S = 2.0
"""At the beginning, which the ordinary subscriber does not measure: pools are made, and the bad one is spoiled."""
_POSE = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
_NEW: dict[str, Any] = {"stamp_ns": 0, "seq": 0, "frame": "world"}


def robot() -> tuple[Stream, ...]:
    """What the simulation says: small, and often."""
    links = tuple(f"link_{i}" for i in range(12))
    transforms = m.Transforms(**_NEW, parents=("world",) * 12, children=links, T_parent_child=np.tile(_POSE, (12, 1)))
    return (
        Stream(c.CLOCK, m.Clock(**_NEW), 100.0),
        Stream(c.JOINTS_STATE, m.JointState(**_NEW, q=np.zeros(8), dq=np.zeros(8)), 100.0),
        Stream(c.TF, transforms, 100.0),
        Stream(c.LEG_STATE, m.LegState(**_NEW, fixed_foot=m.Foot.A, T_world_foot=_POSE), 10.0),
    )


def lidar() -> tuple[Stream, ...]:
    """What the default LiDAR says."""
    scan = m.LidarScan(
        **_NEW,
        points_m=np.random.default_rng(0).normal(0, 5, (_NUM_POINTS, 3)).astype(np.float32),
        intensity=np.zeros(_NUM_POINTS, np.float32),
        t_ns=np.zeros(_NUM_POINTS, np.uint32),
        ring=np.zeros(_NUM_POINTS, np.uint16),
    )
    imu = m.Imu(**_NEW, angular_velocity_radps=np.zeros(3), linear_acceleration_mps2=np.zeros(3))
    return (Stream(c.LIDAR_POINTS, scan, 10.0), Stream(c.LIDAR_IMU, imu, 100.0))


def camera() -> tuple[Stream, ...]:
    """What the default depth camera says."""
    depth_mm = np.random.default_rng(0).integers(500, 5000, 848 * 480).astype(np.uint16)
    image = m.DepthImage(**_NEW, height=480, width=848, depth_mm=depth_mm)
    imu = m.Imu(**_NEW, angular_velocity_radps=np.zeros(3), linear_acceleration_mps2=np.zeros(3))
    return (Stream(c.DEPTH_IMAGE, image, 15.0), Stream(c.DEPTH_IMU, imu, 200.0))


SPEAKERS = {"robot": robot, "lidar": lidar, "camera": camera}


def speak(bus: Bus, streams: tuple[Stream, ...], seconds: float) -> dict[str, int]:
    """Publishes every message that is due, however late it is; returns how many of each key."""
    begin_ns = time.monotonic_ns()
    num_sent = dict.fromkeys((stream.channel.key for stream in streams), 0)
    while True:
        due_ns, stream = min(
            ((begin_ns + int(num_sent[s.channel.key] * 1e9 / s.rate_hz), s) for s in streams), key=lambda due: due[0]
        )
        if due_ns >= begin_ns + seconds * 1e9:
            return num_sent
        time.sleep(max(0.0, (due_ns - time.monotonic_ns()) / 1e9))
        bus.publish(stream.channel, replace(stream.message, seq=num_sent[stream.channel.key], stamp_ns=due_ns))
        num_sent[stream.channel.key] += 1


def listen(bus: Bus, seconds: float) -> dict[str, dict[str, object]]:
    """Latencies of what comes, and how many were missed, by key."""
    inbox = Inbox(max_bytes=2**28)
    for channel in HEARD:
        bus.subscribe(channel, inbox)
    _begin()
    latency_ms: dict[str, list[float]] = defaultdict(list)
    counters: dict[str, SequenceCounter] = defaultdict(SequenceCounter)
    begin_s = time.monotonic()
    while time.monotonic() < begin_s + seconds:
        if (parcel := inbox.take(0.1)) is None or parcel.is_replay:
            continue
        message = decode(parcel.channel.message, parcel.payload, schema=parcel.schema)
        assert isinstance(message, m.Measurement)
        if message.stamp_ns * 1e-9 < begin_s + SETTLE_S:
            continue
        latency_ms[parcel.channel.key].append(round((parcel.received_ns - message.stamp_ns) / 1e6, 3))
        counters[parcel.channel.key].add(message.seq)
    return {key: {"latency_ms": latency_ms[key], "num_missed": counters[key].num_missed} for key in latency_ms}


class SleepyInbox(Inbox):
    """Takes ten times as long for each message as there is between two of them."""

    def put(self, parcel: Parcel) -> bool:
        """Sleeps on the thread that brought the parcel."""
        time.sleep(10 / (parcel.channel.rate_hz or 10.0))
        return True


def _begin() -> None:
    print("ready", flush=True)
    sys.stdin.readline()


def main() -> None:
    """Plays one role."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("role", choices=[*SPEAKERS, "listener", "bystander", "sleeper"])
    parser.add_argument("--endpoint", required=True)
    parser.add_argument("--seconds", type=float, required=True)
    parser.add_argument("--shared-memory-mib", type=int, default=BusConfig().shared_memory_mib)
    arguments = parser.parse_args()
    config = BusConfig(endpoint=arguments.endpoint, shared_memory_mib=arguments.shared_memory_mib)
    with Bus(config) as bus:
        if arguments.role in SPEAKERS:
            streams = SPEAKERS[arguments.role]()
            for stream in streams:
                bus.advertise(stream.channel)
            _begin()
            print(json.dumps(speak(bus, streams, arguments.seconds)))
        elif arguments.role == "listener":
            print(json.dumps(listen(bus, arguments.seconds)))
        else:
            inbox = SleepyInbox() if arguments.role == "sleeper" else Inbox()
            for stream in (stream for streams in SPEAKERS.values() for stream in streams()):
                bus.subscribe(stream.channel, inbox)
            _begin()
            sys.stdin.read()


if __name__ == "__main__":
    main()
