"""Scans are found near the guesses, farther off when these fail, and enter the target when they are believed."""

import numpy as np
import pytest

from services.mapper.methods.gicp import Gicp
from services.mapper.point_matcher import PointMatcher
from services.mapper.registration import RegistrationError
from shared.geometry import SE3
from shared.runtime.config import MapperConfig
from tests.support.steel_clouds import steel_cloud

STAND = SE3.identity()
CONFIG = MapperConfig(min_range_m=0.0)


def started(config=CONFIG):
    matcher = PointMatcher(config, Gicp)
    matcher.start(steel_cloud(1, num=12_000), STAND)
    return matcher


def scan(T_map_lidar, seed=2):
    return T_map_lidar.inv().apply(steel_cloud(seed, num=12_000)).astype(np.float32)


def assert_near(T, expected, within_m=0.003):
    error = T.inv() @ expected
    assert np.linalg.norm(error.translation) < within_m
    assert error.angle_rad < within_m


def test_a_scan_is_found_from_the_first_guess():
    T_map_lidar = SE3.trans(0.02, 0.03) @ SE3.rot("z", 0.03)
    result = started().align(scan(T_map_lidar), [STAND], 1.0)
    assert_near(result.T_map_lidar, T_map_lidar)
    assert result.score > 0.7
    assert 2000 < result.num_points < 6000


def test_a_better_guess_is_taken_though_it_comes_later():
    T_map_lidar = SE3.trans(0.8, 0.3, 0.4) @ SE3.rot("z", 1.0)
    guesses = [SE3.trans(z_m=5.0), T_map_lidar @ SE3.trans(x_m=0.03)]
    assert_near(started().align(scan(T_map_lidar), guesses, 1.0).T_map_lidar, T_map_lidar)


def test_the_search_widens_when_the_guesses_fail():
    T_map_lidar = SE3.trans(0.15, 0.3, 0.1) @ SE3.rot("x", 0.2)
    near = Gicp(steel_cloud(1), CONFIG).align(scan(T_map_lidar), STAND, CONFIG.max_correspondence_m)
    assert near.score < CONFIG.min_score
    assert_near(started().align(scan(T_map_lidar), [STAND], 1.0).T_map_lidar, T_map_lidar)


@pytest.mark.parametrize("scan_to", ["map", "scan"])
def test_what_was_accepted_is_in_the_target_where_it_was_said_to_be(scan_to):
    matcher = started(CONFIG.model_copy(update={"scan_to": scan_to}))
    new = np.random.default_rng(3).uniform(4.0, 5.0, (4000, 3))
    matcher.align(np.concatenate([scan(STAND), new]), [STAND], 1.0)
    assert matcher.target_points_m.max() < 3.5
    matcher.accept(SE3.trans(x_m=0.5))
    assert matcher.target_points_m[:, 0].max() == pytest.approx(5.5, abs=0.1)


def test_a_target_of_the_last_scan_forgets_the_one_before():
    matcher = started(CONFIG.model_copy(update={"scan_to": "scan"}))
    matcher.align(steel_cloud(2) * 0.5, [STAND], 1.0)
    matcher.accept(STAND)
    assert np.abs(matcher.target_points_m).max() < 2.0


@pytest.mark.parametrize("num_points", [0, 1, 2])
def test_a_scan_of_few_points_scores_nothing_and_changes_nothing(num_points):
    matcher = started()
    before = matcher.target_points_m
    guess = SE3.trans(x_m=0.1)
    result = matcher.align(steel_cloud(2)[:num_points], [guess], 1.0)
    assert (result.score, result.T_map_lidar) == (0.0, guess)
    matcher.accept(guess)
    np.testing.assert_array_equal(matcher.target_points_m, before)
    with pytest.raises(RegistrationError, match=f"the target has {num_points} points"):
        matcher.start(steel_cloud(2)[:num_points], STAND)


def test_without_a_start_there_is_nothing_to_align_to():
    with pytest.raises(RegistrationError, match="start with a scan"):
        PointMatcher(CONFIG, Gicp).align(steel_cloud(1), [STAND], 1.0)


def test_a_full_map_still_takes_scans_from_afar():
    matcher = started(CONFIG.model_copy(update={"max_map_points": 1000, "max_range_m": 3.0}))
    matcher.align(scan(STAND), [STAND], 1.0)
    matcher.accept(SE3.trans(x_m=100.0))
    assert len(matcher.target_points_m) == 1000
    assert matcher.align(scan(STAND), [STAND], 1.0).num_inliers > 0
