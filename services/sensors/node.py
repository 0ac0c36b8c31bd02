"""Wiring of the simulated sensors: each by its name, each a process of its own."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from services.sensors.depth.camera import DepthCamera
from services.sensors.imu import InertialUnit
from services.sensors.lidar.scanner import LidarScanner
from services.sensors.loading import load_lidar, sensor_seed, warm_up
from shared.errors import ConfigError
from shared.messaging.channels import (
    DEPTH_POINTS,
    ROBOT_DESCRIPTION,
    STRUCTURE_DESCRIPTION,
    TF,
    sensor_channels,
)
from shared.messaging.frames import FrameTree
from shared.messaging.messages import Message, Transforms
from shared.runtime.config import Config
from shared.runtime.node import Context, Node
from shared.runtime.sensor_config import LidarConfig


def build_node(name: str, config: Config, context: Context) -> Node:
    """The node of one configured sensor, which turns true transforms into its measurements.

    Raises:
        ConfigError: no sensor of this name. InputFileError: its table of beams is not usable.
    """
    sensor = config.sensors.named().get(name)
    if sensor is None:
        raise ConfigError([f"sensors: no sensor '{name}'; configured are {', '.join(config.sensors.named())}"])
    warm_up(sensor)
    seed = sensor_seed(config.seed, name)
    others = config.sensors.other_robots
    facade: LidarScanner | DepthCamera
    if isinstance(sensor, LidarConfig):
        facade = load_lidar(sensor, seed, name, others)
    else:
        points = DEPTH_POINTS.of_sensor(name)
        wants_points = lambda: context.is_wanted(points)  # noqa: E731 - the runner lends it later
        facade = DepthCamera(sensor, seed, wants_points, name, others)
    imu_rng = np.random.default_rng(sensor_seed(config.seed, f"{name}/imu"))
    imu = InertialUnit(sensor.imu, sensor.frame, imu_rng, config.sim.dynamics.gravity_mps2)
    return Node(
        name=name,
        inputs={
            ROBOT_DESCRIPTION: facade.set_robot,
            STRUCTURE_DESCRIPTION: facade.set_structure,
            TF: _feeding(facade, imu, sensor.frame),
            **{ROBOT_DESCRIPTION.of_robot(other): partial(facade.set_other, other) for other in others},
            **{TF.of_robot(other): partial(facade.place_other, other) for other in others},
        },
        outputs=sensor_channels(name),
    )


def _feeding(
    facade: LidarScanner | DepthCamera, imu: InertialUnit, frame: str
) -> Callable[[Transforms], list[Message]]:
    """Transforms go to the IMU as the pose of its frame, and to the sensor as they are."""

    def feed(transforms: Transforms) -> list[Message]:
        if not facade.is_ready:
            return []
        T_world_sensor = FrameTree(transforms).T_root(frame)
        return [*imu.add_pose(transforms.stamp_ns, T_world_sensor), *facade.add_transforms(transforms)]

    return feed
