import numpy as np
import pytest

from shared.geometry import SE3
from shared.messaging.messages import Foot
from shared.robot.inverse_kinematics import BRANCHES, candidates, solve, solve_batch
from shared.robot.kinematics import RobotGeometry, T_footA_footB, foot_matrices
from tests.support.postures import posture_distance, random_postures

NEAR_ZERO = [0.0, 1e-3, 1e-5, 1e-7, 1e-8, 2e-9, 9e-10, 1e-10, 1e-12, 1e-15]


def poses_of(q):
    """T_footA_footB beside every branch (..., 4, 4, 4)."""
    return foot_matrices(q)[..., None, :, :]


def test_the_published_branches():
    # a posture that moves every joint; the branches are from an independent implementation of the same formulas
    T = T_footA_footB([0.3, 0.02, -0.2, 0.5, -0.9, 0.4, -0.01, 0.25])
    expected = {
        (1, 1): [-0.7082254402462, 0.1100370735942, -2.3333672133436, 0.5, -0.1, -2.7415926535898, -0.01, 0.25],
        (1, -1): [0.3, 0.02, 2.9415926535898, 2.6415926535898, -2.2415926535898, -2.7415926535898, -0.01, 0.25],
        (-1, 1): [0.3, 0.02, -0.2, 0.5, -0.9, 0.4, -0.01, 0.25],
        (-1, -1): [-0.708225440246, 0.110037073594, 0.808225440246, 2.641592653590, -3.041592653590, 0.4, -0.01, 0.25],
    }
    got = solve_batch(T.matrix, -0.01, 0.25)
    np.testing.assert_allclose(got, [expected[branch] for branch in BRANCHES], atol=1e-12)
    np.testing.assert_array_equal(solve(T, -0.01, 0.25), got)


def test_twenty_thousand_random_postures_come_back():
    q = random_postures(20_000)
    found = solve_batch(foot_matrices(q), q[:, 6], q[:, 7])
    assert np.nanmin(posture_distance(found, q[:, None]), axis=1).max() < 1e-9
    assert np.abs(foot_matrices(found) - poses_of(q)).max() < 1e-13  # every branch of every posture, none is NaN


@pytest.mark.parametrize("gamma", [0.0, np.pi, -np.pi])
def test_singular_postures_come_back_with_their_alpha(gamma):
    q = random_postures(2_000)
    q[:, 4] = gamma - q[:, 3]
    q[:500, 3], q[:500, 4] = 0.0, gamma  # both legs and the hip in one plane
    found = solve_batch(foot_matrices(q), q[:, 6], q[:, 7], q[:, 0] + q[:, 2])
    assert np.isnan(found[:, 2:]).all()
    found = found[:, :2]
    assert posture_distance(found, q[:, None]).min(axis=1).max() < 1e-9
    assert np.abs(foot_matrices(found) - poses_of(q)).max() < 1e-13


@pytest.mark.parametrize("gamma", [0.0, np.pi])
@pytest.mark.parametrize("away", NEAR_ZERO)
def test_near_singular_poses_are_reached(gamma, away):
    q = random_postures(500)
    q[:, 4] = gamma + away - q[:, 3]
    found = solve_batch(foot_matrices(q), q[:, 6], q[:, 7], 0.3)
    is_solution = ~np.isnan(found[..., 0])
    assert (is_solution.sum(axis=1) == (4 if away > 1e-9 else 2)).all()
    error = np.abs(foot_matrices(found) - poses_of(q)).max(axis=(-2, -1))
    assert error[is_solution].max() < 1e-9


@pytest.mark.parametrize("away", NEAR_ZERO)
def test_poses_are_reached_where_the_branches_of_q4_meet(away):
    q = random_postures(500)
    q[:, 3] = np.pi / 2 - away
    found = solve_batch(foot_matrices(q), q[:, 6], q[:, 7])
    assert np.abs(foot_matrices(found) - poses_of(q)).max() < 1e-9
    if away == 0 or away > 1e-6:
        assert posture_distance(found, q[:, None]).min(axis=1).max() < 1e-9


def test_alpha_is_free_where_both_legs_are_in_one_plane():
    q = np.array([-0.6, 0.0, 0.6, 0.0, 0.0, 0.6, 0.0, -0.6])
    alphas = np.linspace(-3, 3, 61)
    found = solve_batch(T_footA_footB(q).matrix, q[6], q[7], alphas)[:, :2]
    assert np.abs(foot_matrices(found) - T_footA_footB(q).matrix).max() < 1e-14
    np.testing.assert_allclose(np.cos(found[..., 0] + found[..., 2]), np.cos(alphas)[:, None] * [1, 1], atol=1e-12)


def test_what_is_too_far_aside_has_no_solution():
    assert solve(SE3.trans(y_m=0.16), 0.0, 0.0).shape == (0, 8)
    assert np.isnan(solve_batch(SE3.trans(y_m=0.16).matrix, 0.0, 0.0)).all()
    assert len(solve(SE3.trans(y_m=0.15), 0.0, 0.0)) == 2


def test_other_lengths():
    other = RobotGeometry(plate_to_axis_m=0.03, leg_m=0.25, hip_axes_m=0.2)
    q = random_postures(100)
    found = solve_batch(foot_matrices(q, other), q[:, 6], q[:, 7], geometry=other)
    assert posture_distance(found, q[:, None]).min(axis=1).max() < 1e-9


def test_wrong_shapes_are_refused():
    with pytest.raises(ValueError, match=r"T_footA_footB must be \(\.\.\., 4, 4\), got \(3, 3\)"):
        solve_batch(np.eye(3), 0.0, 0.0)


def test_candidates_use_alpha_only_where_it_is_free():
    skew = T_footA_footB([0.3, 0.02, -0.2, 0.5, -0.9, 0.4, -0.01, 0.25])
    assert len(candidates(skew, Foot.A, [0.0, 0.01], 0.25, np.linspace(-1, 1, 7))) == 2 * 4
    assert len(candidates(SE3.trans(x_m=0.15), Foot.A, [0.0, 0.01], 0.25, np.linspace(-1, 1, 7))) == 2 * 7 * 2
