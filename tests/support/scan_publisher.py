"""`python -m tests.support.scan_publisher ENDPOINT`: large scans on the bus until it is killed."""

import sys
import time

import numpy as np

from shared.messaging.bus import Bus
from shared.messaging.channels import LIDAR_POINTS
from shared.messaging.messages import LidarScan
from shared.runtime.config import BusConfig

columns = {"points_m": np.zeros((50_000, 3)), "intensity": np.zeros(50_000)}
columns |= {"t_ns": np.zeros(50_000), "ring": np.zeros(50_000)}
with Bus(BusConfig(endpoint=sys.argv[1])) as bus:
    bus.advertise(LIDAR_POINTS)
    for seq in range(10_000):
        bus.publish(LIDAR_POINTS, LidarScan(stamp_ns=seq, seq=seq, frame="lidar", **columns))
        time.sleep(0.02)
