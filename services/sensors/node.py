"""Wiring of the simulated sensors: each by its name, each a process of its own."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from services.sensors.depth.camera import DepthCamera
from services.sensors.imu import InertialUnit
from services.sensors.lidar.beam_files import read_beams
from services.sensors.lidar.scanner import LidarScanner
from shared.errors import ConfigError
from shared.messaging.channels import DEPTH_POINTS, ROBOT_DESCRIPTION, SENSOR_CHANNELS, STRUCTURE_DESCRIPTION, TF, Channel
from shared.messaging.messages import Message, Transforms
from shared.runtime.config import Config
from shared.runtime.node import Context, Node
from shared.runtime.sensor_config import LidarConfig


def build_node(name: str, config: Config, context: Context) -> Node:
    """The node of one configured sensor, which turns true transforms into its measurements.

    Raises:
        ConfigError: no sensor of this name. InputFileError: its table of beams is not usable.
    """
    sensors = config.sensors.named()
    if name not in sensors:
        raise ConfigError([f"sensors: no sensor '{name}'; configured are {', '.join(sensors)}"])
    sensor = sensors[name]
    outputs = {channel.key: channel.of_sensor(name) for channel in SENSOR_CHANNELS[sensor.kind]}
    seed = config.seed_of(name)
    if isinstance(sensor, LidarConfig):
        facade: LidarScanner | DepthCamera = load_lidar(config, name)
    else:
        facade = DepthCamera(sensor, seed, partial(context.is_wanted, outputs[DEPTH_POINTS.key]))
'''+'' if False else '')
