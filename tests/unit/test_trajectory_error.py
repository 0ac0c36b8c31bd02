import numpy as np
import pytest

from services.evaluator.trajectory_error import TrajectoryComparison, compare_trajectories
from shared.geometry import SE3

START = SE3.trans(1.0, 2.0, 3.0) @ SE3.rot("z", 0.5)


def path(step_m):
    return [SE3.trans(x_m=k * step_m) for k in range(4)]


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
    assert error.ate_max_m == pytest.approx(0.03)
    assert error.rpe_rmse_m == pytest.approx(0.01)


def test_rotation_errors_count_in_rpe():
    true = [SE3.identity(), SE3.rot("y", 0.02)]
    assert compare_trajectories([SE3.identity()] * 2, true).rpe_rmse_rad == pytest.approx(0.02)


def test_nothing_to_compare():
    with pytest.raises(ValueError, match="no poses"):
        TrajectoryComparison().result()
