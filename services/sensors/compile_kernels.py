"""Compiles the sensors' kernels once, at set-up, so that no first run waits for them: `python -m ...compile_kernels`.

Numba keeps what it compiled beside the sources, or in the user's cache where these cannot be written. It does not see a
change in a kernel that another file's kernel calls, so what was kept is removed first.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

from services.sensors.depth.camera import DepthCamera
from services.sensors.node import load_lidar
from shared.geometry import SE3
from shared.messaging.messages import RobotDescription, StructureDescription, Transforms
from shared.runtime.sensor_config import DepthConfig, LidarConfig

_ROBOT = '<robot name="r"><link name="sensor"/></robot>'
_ROOM = """<robot name="s"><link name="world">
  <visual><geometry><box size="8 6 4"/></geometry></visual>
  <visual><origin xyz="2 0 0"/><geometry><cylinder radius="0.1" length="1"/></geometry></visual>
</link></robot>"""


def compile_kernels() -> float:
    """Takes a scan and an image with every preset; returns how many seconds that took."""
    for kept in Path(__file__).parent.rglob("__pycache__/*.nb[ic]"):
        kept.unlink()
    started_s = time.perf_counter()
    moving = [_transforms(0, 0.0), _transforms(100_000_000, 0.1)]
    for preset in ("original", "datasheet"):
        lidar = load_lidar(LidarConfig.model_validate({"preset": preset, "frame": "sensor"}), seed=1)
        depth = DepthCamera(DepthConfig.model_validate({"preset": preset, "frame": "sensor"}), 1, lambda: True, "depth")
        for sensor in (lidar, depth):
            sensor.set_robot(RobotDescription(stamp_ns=0, seq=0, frame="sensor", urdf=_ROBOT))
            sensor.set_structure(StructureDescription(stamp_ns=0, seq=0, frame="world", urdf=_ROOM))
        lidar.scan(moving[:1])
        lidar.scan(moving)
        depth.add_transforms(moving[0])
    return time.perf_counter() - started_s


def _transforms(stamp_ns: int, x_m: float) -> Transforms:
    pose = SE3.trans(x_m).xyz_quat_xyzw
    return Transforms(
        stamp_ns=stamp_ns,
        seq=0,
        frame="world",
        parents=("world",),
        children=("sensor",),
        T_parent_child=pose[np.newaxis],
    )


if __name__ == "__main__":
    print("compiling the sensors' kernels ...", file=sys.stderr, flush=True)
    print(f"compiled in {compile_kernels():.0f} s", file=sys.stderr)
