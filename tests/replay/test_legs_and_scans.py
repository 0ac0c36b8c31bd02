"""Legs and scans together: the real simulation, LiDAR and mapper facades, over a change of foot."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from services.evaluator.trajectory_error import compare_trajectories
from services.mapper.mapper import Mapper
from services.player.player import Player
from services.player.trajectory import read_trajectory
from services.sensors.imu import InertialUnit
from services.sensors.loading import load_lidar, sensor_seed
from services.sim.node import load_sim
from shared.geometry import SE3
from shared.messaging.frames import FrameTree
from shared.messaging.messages import (
    Event,
    Imu,
    JointState,
    JointTarget,
    LegState,
    LegTarget,
    LidarScan,
    MapStatus,
    Odometry,
    RobotDescription,
    StructureDescription,
    Transforms,
)
from shared.runtime.config_loading import load_config

SECONDS = 9.0
"""The first two rows of the climb at 0.6 rad/s, with the change of foot between them."""


@dataclass
class Run:
    """What the mapper said, and the true pose at each of its odometries."""

    statuses: list[MapStatus] = field(default_factory=list)
    events: list[str] = field(default_factory=list)
    estimated: list[SE3] = field(default_factory=list)
    true: list[SE3] = field(default_factory=list)

    @property
    def ate_m(self) -> float:
        return compare_trajectories(self.estimated, self.true).ate_rmse_m


def climbed(*settings: str, without: tuple[type, ...] = ()) -> Run:
    """The beginning of the shipped climb, mapped; `without`: messages that the mapper does not get."""
    config = load_config(overrides=["seed=4", "player.speed_radps=0.6", "sensors.lidar.mode=1024x10", *settings])
    player = Player(config.player, read_trajectory(config.player.trajectory))
    lidar = load_lidar(config.sensors.lidar, sensor_seed(config.seed, "lidar"))
    imu = InertialUnit(config.sensors.lidar.imu, "lidar", np.random.default_rng(config.seed))
    mapper, run, true = Mapper(config.mapper), Run(), {}
    takes = {
        RobotDescription: mapper.set_robot,
        JointState: mapper.add_joints,
        LegState: mapper.add_leg_state,
        Imu: mapper.add_imu,
        LidarScan: mapper.add_scan,
    }

    def tell(message) -> None:
        said = [] if type(message) in without else takes.get(type(message), lambda _: [])(message)
        for answer in said:
            if isinstance(answer, MapStatus):
                run.statuses.append(answer)
            if isinstance(answer, Odometry):
                run.estimated.append(SE3.from_xyz_quat_xyzw(answer.T_frame_child))
                run.true.append(true[answer.stamp_ns])
            if isinstance(answer, Event):
                run.events.append(answer.text)

    def sense(message) -> None:
        tell(message)
        if isinstance(message, RobotDescription):
            lidar.set_robot(message)
        if isinstance(message, StructureDescription):
            lidar.set_structure(message)
        if isinstance(message, Transforms):
            true[message.stamp_ns] = FrameTree(message).T_root("lidar")
            for measured in (*imu.add_pose(message.stamp_ns, true[message.stamp_ns]), *lidar.add_transforms(message)):
                tell(measured)

    sim = load_sim(config)
    try:
        waiting = list(sim.start())
        while not run.statuses or run.statuses[-1].stamp_ns < SECONDS * 1e9:
            message = waiting.pop(0) if waiting else None
            if message is None:
                waiting += sim.step()
                continue
            sense(message)
            commands = player.add_joint_state(message) if isinstance(message, JointState) else []
            commands = player.add_leg_state(message) if isinstance(message, LegState) else commands
            for command in commands:
                is_move = isinstance(command, JointTarget)
                waiting += sim.set_joint_target(command) if is_move else sim.set_fixed_foot(command)
    finally:
        sim.close()
    assert {type(command) for command in commands} <= {JointTarget, LegTarget}
    return run


def test_legs_predict_and_agree_with_scans():
    run = climbed()
    assert all(status.is_tracking and status.prior == "legs" for status in run.statuses[1:])
    assert max(status.leg_slip_m for status in run.statuses[1:]) < 0.002
    assert run.ate_m < 0.001
    assert run.events == []


def test_a_foot_that_slips_is_told():
    run = climbed("sim.slip.slide_m=0.03")
    assert any("a foot slipped: legs and scans differ by" in text for text in run.events)
    assert max(status.leg_slip_m for status in run.statuses[1:]) > 0.01
    assert run.ate_m < 0.001


@pytest.mark.parametrize("prior", ["legs", "imu", "constant_velocity"])
def test_bent_scans_are_straightened_by_each_prior(prior):
    bent = ("sensors.lidar.rolling_shutter=true", f"mapper.prior={prior}")
    straight, as_they_are = climbed(*bent), climbed(*bent, "mapper.deskew=false")
    assert {status.prior for status in straight.statuses[2:]} == {prior}
    assert straight.ate_m < 0.002
    assert straight.ate_m < 0.5 * as_they_are.ate_m


def test_without_joints_the_trend_stands_in():
    run = climbed(without=(JointState, Imu))
    assert {status.prior for status in run.statuses} == {"constant_velocity"}
    assert {status.leg_slip_m for status in run.statuses} == {None}
    assert run.ate_m < 0.001
