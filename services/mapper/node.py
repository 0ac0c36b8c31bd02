"""Wiring of the mapper."""

from services.mapper.odometry import Mapper
from shared.messaging.channels import LIDAR_POINTS, MAP_CLOUD, MAP_ODOMETRY, MAP_STATUS
from shared.messaging.messages import LidarScan
from shared.runtime.config import Config
from shared.runtime.node import Context, Messages, Node


def build_node(config: Config, context: Context) -> Node:
    """The node that turns scans into odometry and a map."""
    mapper = Mapper(config.mapper, context.clock_ns)

    def add_scan(scan: LidarScan) -> Messages:
        return mapper.add_scan(scan, context.received_ns)

    return Node(
        name="mapper",
        inputs={LIDAR_POINTS: add_scan},
        outputs=(MAP_ODOMETRY, MAP_STATUS, MAP_CLOUD),
    )
