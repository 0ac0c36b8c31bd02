"""Scans are found without any guess, and a structure that repeats is not guessed at."""

import numpy as np
import pytest

from services.mapper.global_start import GlobalStart, distinct
from services.mapper.hypotheses import best_of
from services.mapper.methods.gicp import Gicp
from services.mapper.methods.two_step import TwoStep
from services.mapper.point_matcher import PointMatcher
from services.mapper.surface_directions import Directions, rotations_between, surface_directions
from shared.geometry import SE3
from shared.runtime.config import MapperConfig
from tests.support.steel_clouds import steel_cloud

CONFIG = MapperConfig(min_range_m=0.0)
FAR = SE3.trans(0.6, -1.0, 0.4) @ SE3.exp([0, 0, 0, 0.9, -1.1, 1.6])
LADDER = [*(((0.6 * k, 0.0, 0.0), (0.1, 1.0, 0.1)) for k in range(12)), ((3.3, 0.55, 0.0), (6.8, 0.1, 0.1))]


def seen(points_map_m, T_map_lidar):
    return T_map_lidar.inv().apply(points_map_m)


def is_near(T, expected, within=0.01):
    error = T.inv() @ expected
    return np.linalg.norm(error.translation) < within and error.angle_rad < within


def matcher_on(points):
    matcher = PointMatcher(CONFIG, Gicp)
    matcher.start(points, SE3.identity())
    return matcher


def test_normals_crowd_about_the_directions_of_the_surfaces():
    rng = np.random.default_rng(1)
    tilted = SE3.exp([0, 0, 0, 0.3, 0.2, -0.5]).rotation
    normals = np.concatenate([np.repeat(tilted.T[[0, 2]], [600, 300], axis=0), rng.standard_normal((100, 3))])
    normals[::2] *= -1.0
    normals += 0.05 * rng.standard_normal(normals.shape)
    found = surface_directions(normals / np.linalg.norm(normals, axis=1, keepdims=True))
    assert np.abs(found.axes[0] @ tilted[:, 0]) > 0.9995
    assert np.abs(found.axes[1] @ tilted[:, 2]) > 0.9995
    np.testing.assert_allclose(found.shares[:2], [0.6, 0.3], atol=0.03)


def test_three_right_angles_fit_each_other_in_24_ways():
    T = SE3.exp([0, 0, 0, 0.3, 0.2, -0.5]).rotation
    shares = np.array([0.5, 0.3, 0.2])
    rotations = rotations_between(Directions(np.eye(3), shares), Directions(T.T, shares))
    assert len(rotations) == 24
    for R in rotations:
        np.testing.assert_allclose(np.abs(T.T @ R).max(axis=0), 1.0, atol=1e-9)
        assert np.linalg.det(R) == pytest.approx(1.0)


def test_directions_at_odd_angles_fit_only_as_they_are():
    axes = np.array([[1.0, 0, 0], [np.cos(1.0), np.sin(1.0), 0], [np.cos(0.5), 0.2, np.sin(1.3)]])
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    T = SE3.exp([0, 0, 0, 0.9, 0.2, -1.5]).rotation
    shares = np.array([0.4, 0.3, 0.3])
    best = rotations_between(Directions(axes, shares), Directions(axes @ T.T, shares))[0]
    np.testing.assert_allclose(best, T, atol=1e-9)


@pytest.mark.parametrize("noise_m", [0.004, 0.02])
def test_a_scan_far_off_is_the_best_candidate(noise_m):
    scan = seen(steel_cloud(2, noise_m=noise_m), FAR)
    candidates = GlobalStart(steel_cloud(1, noise_m=noise_m), 0.05).candidates(scan, 5)
    assert is_near(candidates[0].T_map_lidar, FAR, within=0.12)
    assert candidates[0].share > 0.95
    shares = [candidate.share for candidate in candidates]
    assert shares == sorted(shares, reverse=True)


def test_candidates_are_near_where_they_are_wanted():
    start = GlobalStart(steel_cloud(1), 0.05)
    found = start.candidates(seen(steel_cloud(2), FAR), 10, FAR, np.deg2rad(30.0), 1.0)
    assert 1 < len(found) <= 10
    for candidate in found:
        assert (FAR.inv() @ candidate.T_map_lidar).angle_rad <= np.deg2rad(30.0)
        assert np.linalg.norm(candidate.T_map_lidar.translation - FAR.translation) <= 1.0


def test_of_poses_side_by_side_the_best_one_stays():
    angles_rad, at_m = [0.0, 0.1, 0.3, 0.0, 0.0], [0.0, 0.1, 0.1, 0.1, 0.3]
    rotations = np.array([SE3.rot("y", angle_rad).rotation for angle_rad in angles_rad])
    shifts_m = np.outer(at_m, [0.0, 0.0, 1.0])
    found = distinct(rotations, shifts_m, np.array([0.7, 0.6, 0.5, 0.9, 0.8]), 5)
    assert [candidate.share for candidate in found] == [0.9, 0.8, 0.5]
    assert len(distinct(rotations, shifts_m, np.arange(5.0), 2)) == 2


@pytest.mark.parametrize("num_points", [0, 1, 2, 500])
def test_surfaces_of_one_direction_give_no_candidate(num_points):
    floor = np.random.default_rng(2).uniform(-1, 1, (num_points, 3)) * [1.0, 1.0, 0.0]
    assert GlobalStart(steel_cloud(1), 0.05).candidates(floor, 5) == []
    assert GlobalStart(floor, 0.05).candidates(steel_cloud(1), 5) == []


def test_a_scan_is_localised_in_the_whole_target():
    result = matcher_on(steel_cloud(1, num=12_000)).localise(seen(steel_cloud(2, num=12_000), FAR))
    assert is_near(result.T_map_lidar, FAR, within=0.003)
    assert result.score > 0.7
    assert not result.is_suspect


def test_where_nothing_fits_nothing_is_found():
    matcher = matcher_on(steel_cloud(1, num=12_000))
    elsewhere = np.random.default_rng(3).uniform(-4, 4, (4000, 3))
    assert matcher.localise(elsewhere) is None
    assert matcher.localise(elsewhere[:2]) is None


def test_a_place_that_looks_like_others_is_suspect():
    part = seen(steel_cloud(2, bars=[*LADDER[3:8], ((2.9, 0.55, 0.0), (2.6, 0.1, 0.1))]), SE3.trans(2.9, 0.0))
    result = matcher_on(steel_cloud(1, num=12_000, bars=LADDER)).localise(part)
    assert result.score > 0.7
    assert result.is_suspect


def test_two_steps_reach_from_30_degrees():
    T_map_lidar = SE3.trans(0.5, 0.5, 0.5) @ SE3.rot("x", np.deg2rad(32.0))
    scan = seen(steel_cloud(2), T_map_lidar)
    by_points_alone = best_of(Gicp(steel_cloud(1), CONFIG), scan, [SE3.identity()], 0.1)
    assert by_points_alone.score < CONFIG.min_score
    result = TwoStep(steel_cloud(1), CONFIG).align(scan, SE3.identity(), 0.1)
    assert is_near(result.T_map_lidar, T_map_lidar, within=0.003)


def test_two_steps_do_not_leave_a_guess_where_planes_leave_the_way_open():
    floor = np.random.default_rng(2).uniform(-2, 2, (3000, 3)) * [1.0, 1.0, 0.001]
    result = TwoStep(floor, CONFIG).align(floor, SE3.trans(z_m=0.03), 0.1)
    assert np.abs(result.T_map_lidar.translation[2]) < 0.002
    assert not result.is_suspect
