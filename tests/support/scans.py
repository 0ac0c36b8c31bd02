"""Scans without processes: the real simulation, LiDAR and mapper facades called one after the other."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from services.player.trajectory import MoveTo, read_trajectory
from services.sensors.loading import load_lidar, sensor_seed
from services.sim.climbing_sim import ClimbingSim
from shared.geometry import SE3
from shared.messaging.frames import FrameTree
from shared.messaging.messages import (
    JointState,
    JointTarget,
    LegState,
    LegTarget,
    LidarScan,
    RobotDescription,
    StructureDescription,
    Transforms,
)
from shared.robot.urdf import read_urdf
from shared.runtime.config import CONFIGS_DIR, Config
from shared.world.files import load_structure

NUM_SCANS = 8
"""Of the short recording that tests of offline commands share."""


def climb(config: Config, trajectory: Path, num_rows: int, seconds_a_move: float) -> Iterator[tuple[LidarScan, SE3]]:
    """Each scan of the first rows of a trajectory, with T_world_lidar as it truly was."""
    sim = ClimbingSim(
        config.sim,
        urdf_text=read_urdf(config.robot),
        structure=load_structure(config.structure),
        mark_text=read_urdf(CONFIGS_DIR / "robot" / "fixed_foot.urdf"),
    )
    lidar = load_lidar(config.sensors.lidar, sensor_seed(config.seed, "lidar"))
    takes = {
        RobotDescription: lidar.set_robot,
        StructureDescription: lidar.set_structure,
        Transforms: lidar.add_transforms,
    }
    state: dict[type, object] = {}

    def scans(messages: list) -> Iterator[tuple[LidarScan, SE3]]:
        for message in messages:
            state[type(message)] = message
            for scan in takes.get(type(message), lambda _: [])(message):
                yield scan, FrameTree(message).T_root(scan.frame)

    try:
        yield from scans(sim.start())
        for row in itertools.islice(read_trajectory(trajectory), num_rows):
            if not isinstance(row, MoveTo):
                leg = state[LegState]
                assert isinstance(leg, LegState)
                yield from scans(sim.set_fixed_foot(LegTarget(foot=leg.fixed_foot.other)))
                continue
            sim.set_joint_target(JointTarget(q=row.q, duration_s=seconds_a_move))
            for _ in range(10_000):
                yield from scans(sim.step())
                joints = state[JointState]
                assert isinstance(joints, JointState)
                if np.array_equal(joints.q, row.q):
                    break
    finally:
        sim.close()
