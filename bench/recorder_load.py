"""The recorder's full load, for its benchmarks: an OS1-128 at 2048x10 and a D435i at 1280x720 and 15 Hz.

`python -m bench.recorder_load --endpoint E --seconds S` publishes it as two sensors would, with what the two IMUs and
the robot say, and prints as JSON how many messages of each key went out.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from shared.messaging.bus import Bus
from shared.messaging.channels import CLOCK, DEPTH_IMAGE, DEPTH_IMU, LIDAR_IMU, LIDAR_POINTS, Channel
from shared.messaging.codec import encode
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
    return LidarScan(
        stamp_ns=0,
        seq=0,
        frame="lidar",
        points_m=np.stack([level_m * np.cos(azimuth), level_m * np.sin(azimuth), range_m * np.sin(elevation)], axis=1),
        intensity=rng.integers(0, 256, azimuth.size),
        t_ns=np.tile(np.arange(NUM_COLUMNS) * 48_828, NUM_RINGS),
        ring=np.repeat(np.arange(NUM_RINGS), NUM_COLUMNS),
    )


def image() -> DepthImage:
    """A wall seen at an angle, with 5 mm of noise."""
    noise_mm = np.random.default_rng(0).normal(0, 5, (HEIGHT, WIDTH))
    depth_mm = 3000 / np.cos(np.linspace(-0.75, 0.75, WIDTH))[None, :] + noise_mm
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


def publish(bus: Bus, streams: tuple[Stream, ...], seconds: float) -> Counter[str]:
    """Publishes in time, by the wall's clock; what is late is published at once. Stamps are of the wall's clock too."""
    num_sent: Counter[str] = Counter()
    for stream in streams:
        bus.advertise(stream.channel)
        encode(stream.message)
    begin_s = time.monotonic()
    due = [0.0] * len(streams)
    while (now_s := time.monotonic() - begin_s) < seconds:
        index = min(range(len(streams)), key=due.__getitem__)
        if due[index] > now_s:
            time.sleep(min(due[index] - now_s, 0.01))
            continue
        stream = streams[index]
        number = num_sent[stream.channel.key]
        bus.publish(stream.channel, replace(stream.message, seq=number, stamp_ns=time.monotonic_ns()))
        num_sent[stream.channel.key] += 1
        due[index] += 1.0 / stream.rate_hz
    return num_sent


def main() -> None:
    """Publishes until the time is over."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--endpoint", required=True)
    parser.add_argument("--seconds", type=float, default=10.0)
    arguments = parser.parse_args()
    with Bus(BusConfig(endpoint=arguments.endpoint)) as bus:
        print(json.dumps(publish(bus, full_load(), arguments.seconds)))


if __name__ == "__main__":
    main()
