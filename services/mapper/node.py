"""Wiring of the mapper."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from services.mapper.in_turn import InTurn
from services.mapper.mapper import Mapper
from services.mapper.priors.interface import Prior
from services.mapper.state import MapState, PoseState
from services.mapper.warming import warm_up
from shared.cloud_files import read_cloud
from shared.messaging.channels import (
    DEPTH_CAMERA_INFO,
    DEPTH_IMAGE,
    DEPTH_IMU,
    JOINTS_STATE,
    LEG_STATE,
    LIDAR_IMU,
    LIDAR_POINTS,
    MAP_CLOUD,
    MAP_ODOMETRY,
    MAP_PLANES,
    MAP_STATUS,
    ROBOT_DESCRIPTION,
    Channel,
)
from shared.messaging.messages import Message
from shared.runtime.config import Config, MapperConfig
from shared.runtime.node import Context, Handler, Memory, Messages, Node, Part

M = TypeVar("M", bound=Message)

_MAP_PERIOD_S = 2.0
"""How old the map may be that a mapper goes on with: it lacks the scans since, no more."""


def build_node(config: Config, context: Context) -> Node:
    """The node that turns scans, or depth images, into odometry and a map.

    Raises:
        InputFileError: the map to begin with is not usable.
    """
    mapper = load_mapper(config.mapper, context.clock_ns)
    in_turn = InTurn(mapper, config.mapper)

    def restore(states: Mapping[str, Any]) -> Messages:
        if len(states["pose"].motion.readings.stamps_ns):
            in_turn.expect_joints()
        return mapper.restore(states["pose"], states["map"])

    return Node(
        name="mapper",
        inputs=inputs_of(mapper, in_turn, config.mapper, lambda: context.received_ns),
        outputs=(MAP_ODOMETRY, MAP_STATUS, MAP_CLOUD, MAP_PLANES),
        memory=Memory(
            {"pose": Part(PoseState, mapper.pose_snapshot), "map": Part(MapState, mapper.map_snapshot, _MAP_PERIOD_S)},
            restore,
        ),
    )


def inputs_of(
    mapper: Mapper, in_turn: InTurn, config: MapperConfig, received_ns: Callable[[], int]
) -> dict[Channel, Handler]:
    """What the mapper takes, and the method for it. received_ns: when the message in hand was received.

    Of scans the newest do; readings are taken one and all, or the map would depend on which of them were dropped.
    """

    def timed(add: Callable[[M, int], Messages]) -> Handler:
        return lambda message: add(message, received_ns())

    lidar: dict[Channel, Handler] = {LIDAR_POINTS: timed(in_turn.add_scan), LIDAR_IMU.every(): in_turn.add_imu}
    depth: dict[Channel, Handler] = {
        DEPTH_IMAGE: timed(in_turn.add_image),
        DEPTH_CAMERA_INFO: mapper.set_camera,
        DEPTH_IMU.every(): in_turn.add_imu,
    }
    return {
        ROBOT_DESCRIPTION: mapper.set_robot,
        JOINTS_STATE.every(): in_turn.add_joints,
        LEG_STATE: in_turn.add_leg_state,
        **(lidar if config.input == "lidar" else depth),
    }


def load_mapper(config: MapperConfig, clock_ns: Callable[[], int], prior: Prior | None = None) -> Mapper:
    """The mapper, with its kernels compiled and the map it begins with. prior: instead of the configured one.

    Raises:
        InputFileError: the map to begin with is not usable.
    """
    warm_up(config)
    loaded_map_m = None if config.map_file is None else read_cloud(config.map_file).points_m
    return Mapper(config, clock_ns, prior=prior, loaded_map_m=loaded_map_m)
