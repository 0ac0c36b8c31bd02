"""A LiDAR in a room without a simulation: descriptions and transforms by hand, presets with single changes."""

import numpy as np

from services.sensors.lidar.beams import uniform_beams
from services.sensors.lidar.scanner import LidarScanner
from shared.geometry import SE3
from shared.messaging.messages import RobotDescription, StructureDescription, Transforms
from shared.runtime.sensor_config import LidarConfig

ROBOT = """<robot name="r">
  <link name="body"><visual><origin xyz="0 0 -1"/><geometry><box size="0.4 0.4 0.4"/></geometry></visual></link>
  <link name="lidar"/>
  <joint name="mount" type="fixed"><parent link="body"/><child link="lidar"/></joint>
</robot>"""
ROOM = """<robot name="s"><link name="world">
  <visual><geometry><box size="8 6 4"/></geometry></visual>
</link></robot>"""


def lidar_config(**changes):
    """The preset `ideal` with these settings changed."""
    return LidarConfig.model_validate({"preset": "ideal", **changes})


def beams(num_columns=16, num_rings=8, top_deg=22.8, bottom_deg=-22.8):
    return uniform_beams(num_rings, top_deg, bottom_deg, num_columns)


def robot(urdf=ROBOT):
    return RobotDescription(stamp_ns=0, seq=0, frame="body", urdf=urdf)


def structure(urdf=ROOM):
    return StructureDescription(stamp_ns=0, seq=0, frame="world", urdf=urdf)


def transforms(stamp_ms, T_world_body=None):
    poses = [(T_world_body or SE3.identity()).xyz_quat_xyzw, SE3.identity().xyz_quat_xyzw]
    return Transforms(
        stamp_ns=round(stamp_ms * 1e6),
        seq=0,
        frame="world",
        parents=("world", "body"),
        children=("body", "lidar"),
        T_parent_child=np.array(poses),
    )


def scanner(config=None, lidar_beams=None, seed=1, room=ROOM, robot_urdf=ROBOT, other_robots=()):
    lidar = LidarScanner(config or lidar_config(), lidar_beams or beams(), seed, other_robots=other_robots)
    assert lidar.set_robot(robot(robot_urdf)) == []
    assert lidar.set_structure(structure(room)) == []
    return lidar
