"""Every registration method finds a known pose, and says honestly what it does not know."""

import dataclasses

import numpy as np
import pytest

from services.mapper.methods import METHODS
from services.mapper.registration import RegistrationResult
from services.mapper.uncertainty import AXES, covariance, degenerate_axes
from shared.geometry import SE3
from shared.runtime.config import MapperConfig

CONFIG = MapperConfig()
T_MAP_LIDAR = SE3.exp(np.array([0.03, -0.02, 0.01, 0.02, -0.01, 0.03]))


def corner(num=900, seed=1, noise_m=0.003):
    """Points on three walls that meet at (-1, -1, -1), in the map frame."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1, 1, (3 * num, 3))
    for axis in range(3):
        points[axis * num : (axis + 1) * num, axis] = -1.0
    return points + noise_m * rng.standard_normal(points.shape)


def floor(num=2000):
    rng = np.random.default_rng(2)
    return np.column_stack([rng.uniform(-2, 2, (num, 2)), 0.002 * rng.standard_normal(num)])


def seen(points_map_m):
    return T_MAP_LIDAR.inv().apply(points_map_m)


@pytest.fixture(params=sorted(METHODS))
def method(request):
    return METHODS[request.param]


def test_a_known_pose_is_found(method):
    result = method(corner(seed=1), CONFIG).align(seen(corner(seed=5)), SE3.identity(), 0.2)
    error = T_MAP_LIDAR.inv() @ result.T_map_lidar
    assert np.linalg.norm(error.translation) < 0.002
    assert error.angle_rad < 0.002
    assert result.is_converged
    assert result.num_points == 2700
    assert result.num_inliers > 2500
    assert result.fitness_m2 == pytest.approx(2 * 0.003**2, rel=0.5)
    assert 0.8 < result.score <= 1.0


def test_without_overlap_nothing_is_claimed(method):
    result = method(corner(), CONFIG).align(seen(corner()) + 50.0, SE3.identity(), 0.2)
    assert (result.num_inliers, result.fitness_m2, result.score) == (0, None, 0.0)
    assert covariance(result) is None


def test_a_corner_determines_every_axis(method):
    result = method(corner(), CONFIG).align(seen(corner(seed=5)), SE3.identity(), 0.2)
    assert degenerate_axes(result.hessian) == ()
    deviations = np.sqrt(np.diag(covariance(result)))
    assert (deviations > 1e-6).all()
    assert (deviations < 1e-3).all()


def test_the_covariance_is_how_much_the_result_scatters(method):
    target = method(corner(seed=1), CONFIG)
    results = [target.align(seen(corner(seed=seed)), T_MAP_LIDAR, 0.2) for seed in range(10, 40)]
    scatter_m = np.std([result.T_map_lidar.translation for result in results], axis=0)
    expected_m = np.sqrt(np.diag(covariance(results[0])))[:3]
    assert ((expected_m / scatter_m > 0.4) & (expected_m / scatter_m < 2.5)).all()


@pytest.mark.parametrize(
    ("points", "open_axes"),
    [(floor(), {"x", "y", "yaw"}), (np.roll(floor(), 1, axis=1), {"y", "z", "roll"})],
    ids=["floor", "wall"],
)
def test_one_plane_leaves_sliding_and_turning_on_it_open(method, points, open_axes):
    T_map_lidar = SE3.rot("z", 0.5 * np.pi) @ SE3.rot("y", 0.3)
    result = method(points, CONFIG).align(T_map_lidar.inv().apply(points), T_map_lidar, 0.2)
    assert set(degenerate_axes(result.hessian)) == open_axes
    assert covariance(result) is None


def test_the_score_is_the_explained_share_less_what_lies_off_the_surfaces():
    perfect = RegistrationResult(
        T_map_lidar=T_MAP_LIDAR,
        is_converged=True,
        num_iterations=1,
        num_points=100,
        num_inliers=80,
        fitness_m2=0.0,
        hessian=np.eye(6),
    )
    assert perfect.score == pytest.approx(0.8)
    assert dataclasses.replace(perfect, fitness_m2=0.01**2).score == pytest.approx(0.4)


def test_without_any_weight_every_axis_is_open():
    assert degenerate_axes(np.zeros((6, 6))) == AXES


def test_distances_are_to_the_nearest_target_point(method):
    target = method(np.array([[k, 0.0, 0.0] for k in range(30)]), CONFIG)
    np.testing.assert_allclose(target.distances(np.array([[2.0, 0.5, 0.0], [40.0, 0.0, 0.0]])), [0.5, 11.0])
