import numpy as np
import pytest

from services.evaluator.trajectory_error import TrajectoryComparison, compare_trajectories, errors_by_distance
from shared.geometry import SE3

START = SE3.trans(1.0, 2.0, 3.0) @ SE3.rot("z", 0.5)


def path(step_m, num_poses=4):
    return [SE3.trans(x_m=k * step_m) for k in range(num_poses)]


def test_the_frames_may_differ():
    true = [START @ pose for pose in path(0.1)]
    error = compare_trajectories(path(0.1), true)
    assert error.num_poses == 4
    assert error.ate_rmse_m == pytest.approx(0.0, abs=1e-12)
    assert error.rpe_rmse_m == pytest.approx(0.0, abs=1e-12)


def test_a_scale_error_in_closed_form():
    true = [START @ pose for pose in path(0.11)]
    error = compare_trajectories(path(0.1), true)
    assert error.ate_rmse_m == pytest.approx(np.sqrt((0.01**2 + 0.02**2 + 0.03**2) / 4))
    assert error.ate_mean_m == pytest.approx(0.015)
    assert error.ate_max_m == pytest.approx(0.03)
    assert error.rpe_rmse_m == pytest.approx(0.01)
    assert (error.drift_m, error.path_m) == (pytest.approx(0.03), pytest.approx(0.33))
    assert error.drift_share == pytest.approx(1 / 11)


def test_rotation_errors_count_in_rpe_and_ate():
    true = [SE3.identity(), SE3.rot("y", 0.02)]
    error = compare_trajectories([SE3.identity()] * 2, true)
    assert error.rpe_rmse_rad == pytest.approx(0.02)
    assert error.ate_rot_rmse_rad == pytest.approx(0.02 / np.sqrt(2))
    assert error.drift_share is None


def test_an_alignment_may_be_given_and_drift_does_not_depend_on_it():
    true = [START @ pose for pose in path(0.11)]
    error = compare_trajectories(path(0.1), true, START @ SE3.trans(0.015))
    assert error.ate_mean_m == pytest.approx((0.015 + 0.005 + 0.005 + 0.015) / 4)
    assert error.drift_m == pytest.approx(0.03)


@pytest.mark.parametrize(
    ("step", "num_ok"),
    [
        (SE3.trans(0.049), 1),
        (SE3.trans(0.051), 0),
        (SE3.rot("x", np.deg2rad(0.99)), 1),
        (SE3.rot("x", np.deg2rad(1.01)), 0),
    ],
)
def test_steps_count_as_right_within_5_cm_and_1_degree(step, num_ok):
    error = compare_trajectories([SE3.identity(), SE3.identity()], [SE3.identity(), step])
    assert (error.num_pairs, error.pairs_ok) == (1, num_ok)


def test_a_slip_costs_one_step():
    estimated = [SE3.trans(x_m=0.1 * k + (0.08 if k >= 5 else 0.0)) for k in range(11)]
    error = compare_trajectories(estimated, path(0.1, 11))
    assert (error.num_pairs, error.pairs_ok) == (10, 9)


def test_drift_along_a_line_grows_with_the_length_of_the_part():
    """10 % too short a step: over parts of 0.5 and 1 m the error is a tenth of them."""
    errors = errors_by_distance(path(0.09, 21), [START @ pose for pose in path(0.1, 21)], (0.5, 1.0, 2.0, 5.0))
    assert [error.length_m for error in errors] == [0.5, 1.0, 2.0]
    assert [error.num_segments for error in errors] == [16, 11, 1]
    np.testing.assert_allclose([error.rmse_m for error in errors], [0.05, 0.1, 0.2], atol=1e-9)
    np.testing.assert_allclose([error.rmse_rad for error in errors], 0.0, atol=1e-9)


def test_a_constant_turn_is_read_in_radians_over_each_part():
    estimated = [SE3.trans(x_m=0.1 * k) @ SE3.rot("x", 0.003 * k) for k in range(21)]
    (error,) = errors_by_distance(estimated, path(0.1, 21), (1.0,))
    assert error.rmse_rad == pytest.approx(0.03, abs=1e-9)


def test_who_stands_still_has_no_parts():
    assert errors_by_distance(path(0.0), path(0.0)) == []
    assert errors_by_distance(path(0.0, 1), path(0.0, 1)) == []


def test_nothing_to_compare():
    with pytest.raises(ValueError, match="no poses"):
        TrajectoryComparison().result()
