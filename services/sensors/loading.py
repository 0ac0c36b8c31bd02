"""Builds sensors from their settings and files."""

from __future__ import annotations

import zlib
from collections.abc import Sequence

import numpy as np

from services.sensors.depth.camera import DepthCamera
from services.sensors.lidar.beam_files import read_beams
from services.sensors.lidar.scanner import LidarScanner
from shared.geometry import SE3
from shared.messaging.messages import RobotDescription, StructureDescription, Transforms
from shared.runtime.sensor_config import DepthConfig, LidarConfig

_ROBOT = '<robot name="r"><link name="{frame}"/></robot>'
_ROOM = """<robot name="s"><link name="world">
  <visual><geometry><box size="8 6 4"/></geometry></visual>
  <visual><origin xyz="2 0 0"/><geometry><cylinder radius="0.1" length="1"/></geometry></visual>
</link></robot>"""


def load_lidar(sensor: LidarConfig, seed: int, name: str = "lidar", other_robots: Sequence[str] = ()) -> LidarScanner:
    """The LiDAR with its table of beams.

    Raises:
        InputFileError: the table is not usable.
    """
    return LidarScanner(sensor, read_beams(sensor.beams, sensor.num_columns), seed, name, other_robots)


def sensor_seed(seed: int, name: str) -> int:
    """Of one sensor, from the seed of the whole and its name: no two sensors share their noise."""
    sequence = np.random.SeedSequence([seed, zlib.crc32(name.encode())])
    return int(sequence.generate_state(1, np.uint64)[0])


def warm_up(sensor: LidarConfig | DepthConfig) -> None:
    """Takes a scan or an image such as this sensor's, once and for nothing, so that its kernels are compiled or loaded.

    Raises:
        InputFileError: the LiDAR's table of beams is not usable.
    """
    if isinstance(sensor, LidarConfig):
        lidar = load_lidar(sensor, seed=0)
        _show_room(lidar, sensor.frame)
        moments = [_transforms(sensor.frame, 0, 0.0), _transforms(sensor.frame, 100_000_000, 0.1)]
        lidar.scan(moments if sensor.rolling_shutter else moments[:1])
    else:
        camera = DepthCamera(sensor, 0, lambda: True)
        _show_room(camera, sensor.frame)
        camera.add_transforms(_transforms(sensor.frame, 0, 0.0))


def _show_room(facade: LidarScanner | DepthCamera, frame: str) -> None:
    facade.set_robot(RobotDescription(stamp_ns=0, seq=0, frame=frame, urdf=_ROBOT.format(frame=frame)))
    facade.set_structure(StructureDescription(stamp_ns=0, seq=0, frame="world", urdf=_ROOM))


def _transforms(frame: str, stamp_ns: int, x_m: float) -> Transforms:
    pose = SE3.trans(x_m).xyz_quat_xyzw[np.newaxis]
    return Transforms(
        stamp_ns=stamp_ns, seq=0, frame="world", parents=("world",), children=(frame,), T_parent_child=pose
    )
