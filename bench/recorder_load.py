"""The recorder's full load, for its benchmarks: an OS1-128 at 2048x10 and a D435i at 1280x720 and 15 Hz.

`python -m bench.recorder_load --endpoint E --seconds S` publishes it as two sensors would, with what the two IMUs and
the robot say, and prints as JSON how many messages of each key went out.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO

import numpy as np

from shared.messaging.bus import Bus
from shared.messaging.channels import CLOCK, DEPTH_IMAGE, DEPTH_IMU, LIDAR_IMU, LIDAR_POINTS, Channel
from shared.messaging.messages import Clock, DepthImage, Imu, LidarScan, Measurement
from shared.runtime.config import BusConfig

NUM_RINGS, NUM_COLUMNS = 128, 2048
HEIGHT, WIDTH = 720, 1280


def scan() -> LidarScan:
    """A revolution in which every ray returns: from a room of 6 m with 1 cm of noise."""
    rng = np.random.default_rng(0)
    azimuth = np.tile(np.linspace(0, 2 * np.pi, NUM_COLUMNS, endpoint=False), NUM_RINGS)
    elevation = np.repeat(np.linspace(0.39, -0.39, NUM_RINGS), NUM_COLUMNS)
    range_m = 3 / np.maximum(np.abs(np.cos(azimuth)), np.abs(np.sin(azimuth))) + rng.normal(0, 0.01, azimuth.size)
    level_m = range_m * np.cos(elevation)
    points_m = np.stack([level_m * np.cos(azimuth), level_m * np.sin(azimuth), range_m * np.sin(elevation)], axis=1)
    return LidarScan(
        stamp_ns=0,
        seq=0,
        frame="lidar",
        points_m=points_m.astype(np.float32),
        intensity=rng.integers(0, 256, azimuth.size).astype(np.float32),
        t_ns=np.tile(np.arange(NUM_COLUMNS, dtype=np.uint32) * 48_828, NUM_RINGS),
        ring=np.repeat(np.arange(NUM_RINGS, dtype=np.uint16), NUM_COLUMNS),
    )


def image() -> DepthImage:
    """A wall seen at an angle, with 5 mm of noise."""
    noise_mm = np.random.default_rng(0).normal(0, 5, (HEIGHT, WIDTH))
    depth_mm = (3000 / np.cos(np.linspace(-0.75, 0.75, WIDTH))[None, :] + noise_mm).astype(np.uint16)
    return DepthImage(stamp_ns=0, seq=0, frame="depth_optical", height=HEIGHT, width=WIDTH, depth_mm=depth_mm.ravel())


@dataclass(frozen=True, slots=True)
class Stream:
    """A message that is published again and again."""

    channel: Channel
    message: Measurement
    rate_hz: float


def full_load() -> tuple[Stream, ...]:
    """The two sensors at their largest, and their IMUs and the clock."""
    imu = Imu(
        stamp_ns=0, seq=0, frame="lidar", angular_velocity_radps=np.zeros(3), linear_acceleration_mps2=np.zeros(3)
    )
    return (
        Stream(LIDAR_POINTS, scan(), 10.0),
        Stream(DEPTH_IMAGE, image(), 15.0),
        Stream(LIDAR_IMU, imu, 100.0),
        Stream(DEPTH_IMU, imu, 200.0),
        Stream(CLOCK, Clock(stamp_ns=0, seq=0, frame="world"), 100.0),
    )


def publish(bus: Bus, streams: tuple[Stream, ...], seconds: float, log: IO[str] | None = None) -> Counter[str]:
    """Publishes by the wall's clock, as sensors do: late is late, nothing is made up for. Stamps: the monotonic clock.

    log: gets a line `key seq stamp_ns` before each message goes out.
    """
    num_sent: Counter[str] = Counter()
    for stream in streams:
        bus.advertise(stream.channel)
    begin_s = time.monotonic()
    due = [0.0] * len(streams)
    while (now_s := time.monotonic() - begin_s) < seconds:
        index = min(range(len(streams)), key=due.__getitem__)
        if due[index] > now_s:
            time.sleep(min(due[index] - now_s, 0.01))
            continue
        stream = streams[index]
        number = num_sent[stream.channel.key]
        message = replace(stream.message, seq=number, stamp_ns=time.monotonic_ns())
        if log is not None:
            log.write(f"{stream.channel.key} {number} {message.stamp_ns}\n")
        bus.publish(stream.channel, message)
        num_sent[stream.channel.key] += 1
        due[index] = max(due[index] + 1.0 / stream.rate_hz, now_s)
    return num_sent


def main() -> None:
    """Publishes until the time is over."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--endpoint", required=True)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--log", type=Path, default=Path(os.devnull))
    arguments = parser.parse_args()
    with Bus(BusConfig(endpoint=arguments.endpoint)) as bus, arguments.log.open("w", buffering=1) as log:
        print(json.dumps(publish(bus, full_load(), arguments.seconds, log)))


if __name__ == "__main__":
    main()
