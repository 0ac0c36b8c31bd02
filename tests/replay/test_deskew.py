"""A scan of the whole line's making, taken while the hip turns: bent as it comes, straight by its true motion."""

from dataclasses import replace

import numpy as np

from services.evaluator.map_accuracy import map_accuracy
from services.sensors.loading import load_lidar
from shared.deskew import deskewed
from shared.geometry import SE3
from shared.messaging.frames import FrameTree, motion_of
from shared.messaging.messages import RobotDescription, StructureDescription, Transforms
from shared.robot.urdf import parse_urdf
from shared.runtime.sensor_config import LidarConfig
from tests.support.robots import ORIGINAL, only, running

MESSAGES = []
STEP_NS = 10_000_000
TURN_RADPS = 1.0


def first_messages():
    if not MESSAGES:
        with running(structure=ORIGINAL) as sim:
            MESSAGES.extend(sim.start())
    return MESSAGES


def turning(transforms, step):
    """The first posture, its hip turned about the vertical so far after so many steps of 10 ms."""
    poses = np.array(transforms.T_parent_child)
    row = transforms.children.index("hip")
    T_parent_hip = SE3.from_xyz_quat_xyzw(poses[row]) @ SE3.rot("z", TURN_RADPS * step * STEP_NS * 1e-9)
    poses[row] = T_parent_hip.xyz_quat_xyzw
    return replace(transforms, stamp_ns=step * STEP_NS, T_parent_child=poses)


def scanner(**changes):
    lidar = load_lidar(LidarConfig.model_validate({"preset": "datasheet", "mode": "1024x10", **changes}), seed=1)
    lidar.set_robot(only(RobotDescription, first_messages()))
    lidar.set_structure(only(StructureDescription, first_messages()))
    return lidar


def mean_distance_m(points_m, T_world_lidar):
    structure = parse_urdf(only(StructureDescription, first_messages()).urdf, "structure")
    is_beyond_robot = np.linalg.norm(points_m, axis=1) > 0.6
    return map_accuracy(T_world_lidar.apply(points_m[is_beyond_robot]), structure).mean_m


def test_a_turning_scan_straightened_is_as_near_to_the_steel_as_a_still_one():
    first = only(Transforms, first_messages())
    moving = [turning(first, step) for step in range(11)]
    scan, still = scanner().scan(moving), scanner().scan(moving[:1])
    motion, T_world_lidar = motion_of(moving, ["lidar"]), FrameTree(moving[0]).T_root("lidar")
    bent_m, straight_m, still_m = (
        mean_distance_m(points_m, T_world_lidar) for points_m in (scan.points_m, deskewed(scan, motion), still.points_m)
    )
    assert bent_m > 3 * still_m
    assert abs(straight_m / still_m - 1) < 0.05


def test_without_other_errors_true_motion_gives_the_structure_back_within_a_millimetre():
    first = only(Transforms, first_messages())
    moving = [turning(first, step) for step in range(11)]
    errorless = {"range_noise_m": 0, "weak_range_noise_m": 0, "range_quantum_m": 0, "exit_m": 0, "divergence_deg": 0}
    scan = scanner(**errorless, self_hits=False).scan(moving)
    points_m = deskewed(scan, motion_of(moving, ["lidar"]))
    structure = parse_urdf(only(StructureDescription, first_messages()).urdf, "structure")
    result = map_accuracy(FrameTree(moving[0]).T_root("lidar").apply(points_m), structure)
    assert len(points_m) > 20_000
    assert result.max_m < 0.001
    assert result.mean_m < 0.0001
