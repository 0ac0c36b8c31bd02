"""The robot of a configuration, with its sensors where the configuration mounts them."""

from __future__ import annotations

import numpy as np

from shared.errors import InputFileError
from shared.geometry import SE3
from shared.robot.mounts import Mount, link_names, with_mounts
from shared.robot.urdf import read_urdf
from shared.runtime.config import Config
from shared.runtime.sensor_config import MountConfig, SensorConfig


def robot_urdf(config: Config) -> str:
    """The robot's URDF; it has the frame of every sensor that is enabled or has a mount.

    Raises:
        InputFileError: the file cannot be read, a mount is not possible, or a sensor has neither frame nor mount.
    """
    sensors = config.sensors.named()
    mounts = [
        _mount(f"{_setting(name)}.mount", sensor.frame, sensor.mount)
        for name, sensor in sensors.items()
        if sensor.mount is not None
    ]
    urdf = with_mounts(read_urdf(config.robot), mounts, str(config.robot))
    links = link_names(urdf, str(config.robot))
    for name, sensor in sensors.items():
        if sensor.enabled and sensor.frame not in links:
            raise InputFileError(_missing_frame(_setting(name), sensor, config, links))
    return urdf


def _setting(name: str) -> str:
    return f"sensors.{name}" if name in ("lidar", "depth") else f"sensors.others.{name}"


def _mount(setting: str, frame: str, mount: MountConfig) -> Mount:
    return Mount(setting, frame, mount.parent, SE3.from_rpy(np.deg2rad(mount.rpy_deg), mount.xyz_m))


def _missing_frame(setting: str, sensor: SensorConfig, config: Config, links: list[str]) -> str:
    return (
        f"{setting}.frame: {config.robot} has no link '{sensor.frame}', and there is no {setting}.mount to add it; "
        f"links are {', '.join(links)}"
    )
