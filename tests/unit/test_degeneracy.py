"""What a Hessian says: covariance, open directions, and the prior that holds them."""

import numpy as np
import pytest

from services.mapper.degeneracy import covariance, degenerate_axes, held
from services.mapper.registration import RegistrationResult
from shared.geometry import SE3

WALL = np.diag([0.0, 0.0, 1000.0, 400.0, 400.0, 0.0])
"""A floor alone: nothing about x, y and yaw."""
ROOM = np.diag([900.0, 800.0, 1000.0, 400.0, 400.0, 300.0])


def found(T_map_lidar, hessian, **fields):
    values = {"num_inliers": 1000, "num_points": 1000, "fitness_m2": 1e-4, "score": 1.0} | fields
    return RegistrationResult(
        T_map_lidar=T_map_lidar, is_converged=True, num_iterations=3, hessian=np.asarray(hessian), **values
    )


def turned(hessian, R):
    both = np.kron(np.eye(2), R)
    return both @ hessian @ both.T


def test_axes_are_named_where_the_hessian_is_flat():
    assert degenerate_axes(ROOM) == ()
    assert degenerate_axes(WALL) == ("x", "y", "yaw")
    assert degenerate_axes(np.zeros((6, 6))) == ("x", "y", "z", "roll", "pitch", "yaw")
    tilted = turned(np.diag([0.0, 1000.0, 1000.0, 400.0, 400.0, 400.0]), SE3.rot("z", np.pi / 4).rotation)
    assert degenerate_axes(tilted) == ("x", "y")


def test_open_directions_are_held_by_the_prediction():
    prediction = SE3.from_rpy([0.0, 0.0, 0.3], [1.0, 2.0, 3.0])
    result = found(SE3.from_rpy([0.05, 0.0, 0.5], [1.4, 2.4, 3.1]), WALL)
    pose = held(result, prediction)
    np.testing.assert_allclose(pose.translation, [1.0, 2.0, 3.1], atol=1e-12)
    rotation = SE3(pose.rotation @ prediction.rotation.T, np.zeros(3)).log()[3:]
    assert abs(rotation[2]) < 1e-9
    assert abs(rotation[0]) > 0.03


def test_what_a_scan_determines_is_not_touched():
    result = found(SE3.from_rpy([0.05, 0.0, 0.5], [1.4, 2.4, 3.1]), ROOM)
    assert held(result, SE3.identity()) is result.T_map_lidar


def test_a_scan_that_says_nothing_leaves_the_prediction():
    prediction = SE3.from_rpy([0.1, 0.2, 0.3], [1.0, 2.0, 3.0])
    pose = held(found(SE3.identity(), np.zeros((6, 6))), prediction)
    np.testing.assert_allclose(pose.matrix, prediction.matrix, atol=1e-12)


@pytest.mark.parametrize(("sigma_m", "variance_m2"), [(None, 1e-4), (0.02, 4e-4)])
def test_covariance_is_the_inverse_hessian_times_the_variance(sigma_m, variance_m2):
    result = found(SE3.identity(), ROOM, sigma_m=sigma_m)
    expected = np.linalg.inv(ROOM) * variance_m2 * 1000 / 994
    np.testing.assert_allclose(covariance(result), expected, rtol=1e-9)


def test_no_covariance_where_a_direction_is_open_or_nothing_was_met():
    assert covariance(found(SE3.identity(), WALL)) is None
    assert covariance(found(SE3.identity(), ROOM, num_inliers=6)) is None
    assert covariance(found(SE3.identity(), ROOM, fitness_m2=None)) is None
