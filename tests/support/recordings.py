"""Small recordings by the recorder's own writer: robot, clock and scans, a chunk a second."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from services.recorder.disk import new_file
from services.recorder.mcap_log import McapLog
from services.recorder.records import to_record
from services.recorder.tally import COMPLETE, END_METADATA, RUN_METADATA
from shared.messaging import channels as c, messages as m

NUM_SECONDS = 5
CLOCK_HZ, SCAN_HZ = 20, 10
_NS_PER_S = 10**9
URDF = "<robot name='r'><link name='foot_a'/></robot>"


def scan(number: int) -> m.LidarScan:
    """Of a revolution that begins at its stamp; its points cannot be compressed."""
    points_m = np.random.default_rng(number).uniform(-5, 5, (200, 3))
    return m.LidarScan(
        stamp_ns=number * _NS_PER_S // SCAN_HZ,
        seq=number,
        frame="lidar",
        points_m=points_m,
        intensity=np.zeros(200),
        t_ns=np.arange(200) * 1000,
        ring=np.zeros(200),
    )


def clock(number: int) -> m.Clock:
    return m.Clock(stamp_ns=number * _NS_PER_S // CLOCK_HZ, seq=number, frame="")


def said() -> list[tuple[c.Channel, m.Message]]:
    """All messages in the order in which they came: a scan comes at its end."""
    robot = m.RobotDescription(stamp_ns=0, seq=0, frame="foot_a", urdf=URDF)
    messages: list[tuple[c.Channel, m.Message]] = [(c.ROBOT_DESCRIPTION, robot)]
    for tick in range(NUM_SECONDS * CLOCK_HZ):
        messages.append((c.CLOCK, clock(tick)))
        if tick == CLOCK_HZ:
            messages.append((c.JOINTS_TARGET, m.JointTarget(q=np.zeros(8))))
        if tick % 2 == 0 and tick:
            messages.append((c.LIDAR_POINTS, scan(tick // 2 - 1)))
    return messages


def write_recording(path: Path, *, compression: str = "lz4") -> Path:
    """`said`, and an end that says COMPLETE."""
    log = McapLog(
        new_file(path), c.CHANNELS, {RUN_METADATA: {"version": "1.2.3", "seed": "7"}}, compression=compression
    )
    stamp_ns = 0
    for channel, message in said():
        if isinstance(message, m.Measurement):
            stamp_ns = max(stamp_ns, message.stamp_ns)
        if isinstance(message, m.Clock) and message.seq and message.seq % CLOCK_HZ == 0:
            log.flush()
        own_ns = message.stamp_ns if isinstance(message, m.Measurement) else stamp_ns
        log.add(to_record(channel, message, own_ns, number=1))
    log.flush()
    log.close({END_METADATA: {"state": COMPLETE, "reason": ""}})
    return path
