"""The line from simulation to map without processes: seeded, so that its figures can be held against references."""

from dataclasses import dataclass

import numpy as np
import pytest

from services.evaluator.map_accuracy import map_accuracy
from services.evaluator.trajectory_error import TrajectoryError, compare_trajectories
from services.mapper.mapper import Mapper
from shared.geometry import SE3
from shared.messaging.messages import MapStatus, Odometry
from shared.robot.urdf import parse_urdf
from shared.runtime.config import Config
from shared.runtime.config_loading import load_config
from shared.world.files import load_structure
from shared.world.urdf_format import structure_urdf
from tests.support.scans import climb


@dataclass
class Mapped:
    error: TrajectoryError
    statuses: list
    map_points_world_m: np.ndarray


def mapped(config: Config, num_rows: int, seconds_a_move: float) -> Mapped:
    mapper = Mapper(config.mapper, clock_ns=lambda: 0)
    estimated, true, statuses = [], [], []
    for scan, T_world_lidar in climb(config, config.player.trajectory, num_rows, seconds_a_move):
        for message in mapper.add_scan(scan, received_ns=0):
            if isinstance(message, Odometry):
                estimated.append(SE3.from_xyz_quat_xyzw(message.T_frame_child))
                true.append(T_world_lidar)
            if isinstance(message, MapStatus):
                statuses.append(message)
    points = true[0].apply(mapper.map_cloud().points_m)
    return Mapped(compare_trajectories(estimated, true), statuses, points)


@pytest.mark.parametrize(
    ("settings", "num_rows", "seconds_a_move", "max_ate_m"),
    [
        # The demo's pace, 1.6 degrees between scans: 0.46 to 0.50 mm with seeds 1 to 4.
        ([], 2, 11.0, 0.0015),
        # The joints' velocity limits, 5.6 degrees between scans: 0.50 to 0.63 mm.
        ([], 4, 3.2, 0.002),
        # Three times the noise: 2.1 to 3.0 mm, as 5,000 thinned points still average it far below a bar's width.
        (["sensors.lidar.range_noise_m=0.025"], 4, 3.2, 0.008),
    ],
    ids=["as the demo", "fast", "noisy"],
)
def test_a_climb_is_mapped_to_millimetres(settings, num_rows, seconds_a_move, max_ate_m):
    config = load_config(overrides=["seed=3", *settings])
    result = mapped(config, num_rows, seconds_a_move)
    assert result.error.num_poses > 60
    assert result.error.ate_rmse_m < max_ate_m
    assert all(status.is_tracking for status in result.statuses)
    structure = parse_urdf(structure_urdf(load_structure(config.structure)), "structure")
    sigma_m = config.sensors.lidar.range_noise_m
    assert map_accuracy(result.map_points_world_m, structure).mean_m < sigma_m


def test_the_same_seed_gives_the_same_map():
    config = load_config()
    first, again = (mapped(config, num_rows=2, seconds_a_move=3.2) for _ in range(2))
    assert first.error == again.error
    np.testing.assert_array_equal(first.map_points_world_m, again.map_points_world_m)
