"""Legs and scans together: the real simulation, LiDAR and mapper facades, over a change of foot."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from cli.offline import climb_messages
from services.evaluator.trajectory_error import compare_trajectories
from services.mapper.mapper import Mapper
from services.player.player import Player
from services.player.trajectory import read_trajectory
from services.sensors.imu import InertialUnit
from services.sensors.loading import load_lidar, sensor_seed
from shared.geometry import SE3
from shared.messaging.frames import FrameTree
from shared.messaging.messages import (
    Event,
    Imu,
    JointState,
    LegState,
    LidarScan,
    MapStatus,
    Odometry,
    RobotDescription,
    StructureDescription,
    Transforms,
)
from shared.runtime.config import Config
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


class Sensed:
    """A mapper with the LiDAR and the IMU whose frame is the LiDAR's; `without`: messages that it does not get."""

    def __init__(self, config: Config, without: tuple[type, ...]) -> None:
        self.run, self._without = Run(), without
        self._lidar = load_lidar(config.sensors.lidar, sensor_seed(config.seed, "lidar"))
        self._imu = InertialUnit(config.sensors.lidar.imu, "lidar", np.random.default_rng(config.seed))
        self._true: dict[int, SE3] = {}
        mapper = Mapper(config.mapper)
        self._takes = {
            RobotDescription: mapper.set_robot,
            JointState: mapper.add_joints,
            LegState: mapper.add_leg_state,
            Imu: mapper.add_imu,
            LidarScan: mapper.add_scan,
        }

    def hear(self, message) -> None:
        """What the simulation says; from transforms follow measurements."""
        self._map(message)
        match message:
            case RobotDescription():
                self._lidar.set_robot(message)
            case StructureDescription():
                self._lidar.set_structure(message)
            case Transforms():
                T_world_lidar = self._true[message.stamp_ns] = FrameTree(message).T_root("lidar")
                for measured in self._imu.add_pose(message.stamp_ns, T_world_lidar):
                    self._map(measured)
                for scan in self._lidar.add_transforms(message):
                    self._map(scan)

    def _map(self, message) -> None:
        if type(message) in self._without or type(message) not in self._takes:
            return
        for answer in self._takes[type(message)](message):
            match answer:
                case MapStatus():
                    self.run.statuses.append(answer)
                case Odometry():
                    self.run.estimated.append(SE3.from_xyz_quat_xyzw(answer.T_frame_child))
                    self.run.true.append(self._true[answer.stamp_ns])
                case Event():
                    self.run.events.append(answer.text)


def climbed(*settings: str, without: tuple[type, ...] = ()) -> Run:
    """The beginning of the shipped climb, mapped."""
    config = load_config(overrides=["seed=4", "player.speed_radps=0.6", "sensors.lidar.mode=1024x10", *settings])
    player = Player(config.player, read_trajectory(config.player.trajectory))
    sensed = Sensed(config, without)
    for message in climb_messages(config, player):
        sensed.hear(message)
        if sensed.run.statuses and sensed.run.statuses[-1].stamp_ns >= SECONDS * 1e9:
            break
    return sensed.run


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
