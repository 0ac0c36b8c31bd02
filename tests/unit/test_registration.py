"""Every registration method finds a known pose, and says honestly what it does not know."""

import numpy as np
import pytest

from services.mapper.degeneracy import AXES, covariance, degenerate_axes
from services.mapper.methods.registry import METHODS
from services.mapper.methods.surface import Surface
from services.mapper.registration import MIN_POINTS, RegistrationError, surface_score
from shared.geometry import SE3
from shared.runtime.config import MapperConfig
from tests.support.steel_clouds import steel_cloud

CONFIG = MapperConfig(max_iterations=50)
T_MAP_LIDAR = SE3.exp(np.array([0.03, -0.02, 0.01, 0.02, -0.01, 0.03]))
FINE = dict.fromkeys(METHODS, 0.003) | {"point_to_point": 0.006}
"""Metres. Nearest points are never the same ones, so that the distances between points pull askew."""
LOCAL = pytest.mark.parametrize("name", sorted(set(METHODS) - {"global"}))
"""A corner looks like itself from three sides: `global` may take any of them."""


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


def seen(points_map_m, T_map_lidar=T_MAP_LIDAR):
    return T_map_lidar.inv().apply(points_map_m)


@pytest.fixture(params=sorted(METHODS))
def name(request):
    return request.param


@pytest.fixture
def method(name):
    return METHODS[name]


@LOCAL
def test_a_known_pose_is_found(name, method):
    result = method(corner(seed=1), CONFIG).align(seen(corner(seed=5)), SE3.identity(), 0.2)
    error = T_MAP_LIDAR.inv() @ result.T_map_lidar
    assert np.linalg.norm(error.translation) < FINE[name]
    assert error.angle_rad < FINE[name]
    assert result.is_converged
    assert result.num_points == 2700
    assert result.num_inliers > 2500
    assert 0.7 < result.score <= 1.0


def test_steel_is_found_from_5_cm_and_5_degrees(name, method):
    T_map_lidar = SE3.trans(0.03, -0.03, 0.03) @ SE3.exp([0, 0, 0, 0.05, 0.05, 0.05])
    registration = method(steel_cloud(1), CONFIG)
    coarse = registration.align(seen(steel_cloud(2), T_map_lidar), SE3.identity(), 0.4)
    result = registration.align(seen(steel_cloud(2), T_map_lidar), coarse.T_map_lidar, 0.1)
    error = T_map_lidar.inv() @ result.T_map_lidar
    assert np.linalg.norm(error.translation) < FINE[name]
    assert error.angle_rad < FINE[name]


@LOCAL
def test_without_overlap_nothing_is_claimed(method):
    result = method(corner(), CONFIG).align(seen(corner()) + 50.0, SE3.identity(), 0.2)
    assert (result.num_inliers, result.fitness_m2, result.score) == (0, None, 0.0)
    assert covariance(result) is None


@pytest.mark.parametrize("num_points", [0, 1, 2, MIN_POINTS - 1])
def test_too_few_points_are_no_scan_and_no_target(method, num_points):
    few = corner()[:num_points]
    result = method(corner(), CONFIG).align(few, T_MAP_LIDAR, 0.2)
    assert (result.num_points, result.score) == (num_points, 0.0)
    np.testing.assert_array_equal(result.T_map_lidar.matrix, T_MAP_LIDAR.matrix)
    assert len(method(corner(), CONFIG).distances(few)) == num_points
    with pytest.raises(RegistrationError, match=f"the target has {num_points} points"):
        method(few, CONFIG)


def test_points_that_are_all_the_same_do_no_harm(method):
    one_place = np.ones((50, 3))
    assert method(corner(), CONFIG).align(one_place, SE3.identity(), 0.2).num_points == 50
    assert method(one_place, CONFIG).align(corner(), SE3.identity(), 0.2).num_points == 2700


def test_a_corner_determines_every_axis(method):
    result = method(corner(), CONFIG).align(seen(corner(seed=5)), SE3.identity(), 0.2)
    assert degenerate_axes(result.hessian) == ()
    deviations = np.sqrt(np.diag(covariance(result)))
    assert (deviations > 1e-6).all()
    assert (deviations < 1e-3).all()


@pytest.mark.parametrize("name", ["gicp", "point_to_plane"])
def test_the_covariance_is_how_much_the_result_scatters(method):
    target = method(corner(seed=1), CONFIG)
    results = [target.align(seen(corner(seed=seed)), T_MAP_LIDAR, 0.2) for seed in range(10, 30)]
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


def test_without_any_weight_every_axis_is_open():
    assert degenerate_axes(np.zeros((6, 6))) == AXES


def test_distances_are_to_the_nearest_target_point(method):
    target = method(np.array([[k, 0.0, 0.0] for k in range(30)]), CONFIG)
    np.testing.assert_allclose(target.distances(np.array([[2.0, 0.5, 0.0], [40.0, 0.0, 0.0]])), [0.5, 11.0])


def grid(num=30):
    """A grid on the plane z = 0 with points 0.1 m apart."""
    x, y = np.meshgrid(0.1 * np.arange(num), 0.1 * np.arange(num))
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(num * num)])


def test_fitness_is_of_the_nearest_points_and_sigma_along_the_normals():
    beside = grid()[:100] + np.array([0.03, 0.0, 0.04])
    result = Surface(grid(), 1).fit(beside, SE3.identity(), 0.06)
    assert result.fitness_m2 == pytest.approx(0.05**2)
    assert result.sigma_m == pytest.approx(0.04)
    assert result.score == pytest.approx(1.0 / (1.0 + 0.04**2 / 0.01**2))
    assert Surface(grid(), 1).fit(beside, SE3.identity(), 0.049).num_inliers == 0


def test_the_hessian_is_that_of_distances_to_a_plane():
    T_map_lidar = SE3.trans(1.0, 2.0, 0.0) @ SE3.rot("z", 0.4)
    tilt = SE3.exp([0.5, 0, 0, 0.7, -0.4, 0.2])
    points, normal = tilt.apply(grid()), tilt.rotation[:, 2]
    result = Surface(points, 1).fit(seen(points, T_map_lidar), T_map_lidar, 0.05)
    arms = np.cross(points - T_map_lidar.translation, normal)
    rows = np.column_stack([np.tile(normal, (len(points), 1)), arms])
    np.testing.assert_allclose(result.hessian, rows.T @ rows, atol=1e-6)


def test_the_score_is_the_explained_share_less_what_lies_off_the_surfaces():
    assert surface_score(80, 100, 0.0, 0.02) == pytest.approx(0.8)
    assert surface_score(80, 100, 0.02**2, 0.02) == pytest.approx(0.4)
    assert surface_score(0, 100, None, 0.02) == surface_score(0, 0, 0.0, 0.02) == 0.0


@pytest.mark.parametrize("noise_m", [0.008, 0.02])
def test_noise_of_the_target_itself_is_not_held_against_a_scan(noise_m):
    score = Surface(corner(seed=1, noise_m=noise_m), 1).fit(corner(seed=5, noise_m=noise_m), SE3.identity(), 0.2).score
    assert 0.75 < score < 0.9
