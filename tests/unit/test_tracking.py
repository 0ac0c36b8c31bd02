"""The tracker with the real GICP in a corner of three walls, a stage at a time."""

import numpy as np
import pytest

from services.mapper.gicp import Gicp
from services.mapper.tracking import Tracker
from shared.geometry import SE3
from shared.runtime.config import MapperConfig

PERIOD_NS = 100_000_000
NEAR_ONLY = MapperConfig(search_correspondence_m=0.1)
"""The wider search sees no farther than the first attempt."""


def corner(seed=1, num=600):
    """Points on three walls of 2 m that meet at (-1, -1, -1), in the map frame."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1, 1, (3 * num, 3))
    for axis in range(3):
        points[axis * num : (axis + 1) * num, axis] = -1.0
    return points + 0.003 * rng.standard_normal(points.shape)


def misleading():
    """The corner and a new wall in front of one of its walls: a wide search lays the known one between the two."""
    new_wall = np.random.default_rng(3).uniform(-1, 1, (900, 3)) * [0, 1, 1] + [-0.6, 0, 0]
    return np.vstack([corner(seed=2), new_wall])


@pytest.fixture(scope="module")
def registration():
    return Gicp(corner(), MapperConfig())


class Run:
    """A tracker that is shown the corner from one true pose after the other."""

    def __init__(self, registration, config):
        self.registration, self.tracker, self.k = registration, Tracker(config, stamp_ns=0), 0

    def see(self, T_map_lidar, points_map_m=None):
        points_map_m = corner(seed=2) if points_map_m is None else points_map_m
        return self.show(T_map_lidar.inv().apply(points_map_m))

    def show(self, points_lidar_m):
        self.k += 1
        return self.tracker.follow(points_lidar_m, self.k * PERIOD_NS, self.registration)


def error_m(track, T_map_lidar):
    return np.linalg.norm((T_map_lidar.inv() @ track.T_map_lidar).translation)


def test_a_blind_scan_is_predicted_and_the_next_stands_still(registration):
    run = Run(registration, MapperConfig())
    for k in (1, 2, 3):
        assert run.see(SE3.trans(x_m=0.05 * k)).is_tracking
    first, second = run.show(np.empty((0, 3))), run.show(np.empty((0, 3)))
    assert (first.is_tracking, second.is_tracking) == (False, False)
    assert error_m(first, SE3.trans(x_m=0.2)) < 0.003
    np.testing.assert_array_equal(second.T_map_lidar.matrix, first.T_map_lidar.matrix)


def test_the_velocity_is_that_of_time_and_not_of_scans(registration):
    run = Run(registration, MapperConfig())
    run.see(SE3.trans(x_m=0.05))
    run.k += 2  # two scans did not come
    run.see(SE3.trans(x_m=0.2))
    assert error_m(run.show(np.empty((0, 3))), SE3.trans(x_m=0.25)) < 0.003


def test_a_sudden_stop_is_found_from_where_it_stood(registration):
    """The prediction overshoots by 51 degrees, and the wide search is misled."""
    run = Run(registration, MapperConfig(max_jump_deg=60.0))
    for k in range(1, 16):
        assert run.see(SE3.rot("z", 0.06 * k * (k + 1) / 2)).is_tracking
    stopped = SE3.rot("z", 0.06 * 120)
    track = run.see(stopped, misleading())
    assert track.is_tracking
    assert error_m(track, stopped) < 0.003


def test_a_sudden_turn_is_found_by_the_wider_search(registration):
    turned = SE3.rot("z", 0.8)
    assert not Run(registration, NEAR_ONLY).see(turned).is_tracking
    track = Run(registration, MapperConfig(max_jump_deg=60.0)).see(turned)
    assert track.is_tracking
    assert error_m(track, turned) < 0.003


def test_the_best_attempt_counts_and_not_the_last(registration):
    track = Run(registration, MapperConfig()).see(SE3.identity(), misleading())
    assert track.is_tracking
    assert error_m(track, SE3.identity()) < 0.003


def test_what_does_not_fit_is_not_believed_however_near(registration):
    anything = MapperConfig(max_jump_m=100.0, max_jump_deg=180.0)
    noise = np.random.default_rng(4).uniform(-1, 1, (2000, 3))
    assert not Run(registration, anything).show(noise).is_tracking


def test_a_jump_is_believed_only_when_it_persists(registration):
    run = Run(registration, MapperConfig(max_jump_m=0.2))
    assert run.see(SE3.trans(x_m=0.01)).is_tracking
    for away in (SE3.trans(x_m=0.35), SE3.identity()):
        refused, believed = run.see(away), run.see(away)
        assert (refused.is_tracking, believed.is_tracking) == (False, True)
        assert error_m(believed, away) < 0.003
        assert run.see(away).is_tracking
