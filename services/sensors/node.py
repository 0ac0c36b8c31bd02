"""Wiring of the sensors: each by its name, each a process of its own."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from services.sensors.lidar import LidarScanner
from shared.messaging.channels import LIDAR_POINTS, ROBOT_DESCRIPTION, STRUCTURE_DESCRIPTION, TF
from shared.runtime.config import Config
from shared.runtime.node import Context, Node


def build_lidar(config: Config, _context: Context) -> Node:
    """The node that turns the true transforms into scans."""
    scanner = LidarScanner(config.sensors.lidar, np.random.default_rng(config.seed))
    return Node(
        name="lidar",
        inputs={
            ROBOT_DESCRIPTION: scanner.set_robot,
            STRUCTURE_DESCRIPTION: scanner.set_structure,
            TF: scanner.add_transforms,
        },
        outputs=(LIDAR_POINTS,),
    )


SENSORS: dict[str, Callable[[Config, Context], Node]] = {"lidar": build_lidar}
"""Sensor name -> builder of its node."""
