import numpy as np
import pytest
from hypothesis import given, strategies as st

from shared.messaging.messages import Foot
from shared.robot.jacobian import foot_and_jacobian, foot_jacobian
from shared.robot.kinematics import T_fixed_free
from tests.support.postures import postures, random_postures

STEP = 1e-6


def by_differences(q, fixed_foot):
    """Central differences of SE3's logarithm, turned from the free foot's frame into the fixed foot's."""
    R = T_fixed_free(q, fixed_foot).rotation
    columns = []
    for step in STEP * np.eye(8):
        twist = (T_fixed_free(q - step, fixed_foot).inv() @ T_fixed_free(q + step, fixed_foot)).log() / (2 * STEP)
        columns.append(np.concatenate([R @ twist[:3], R @ twist[3:]]))
    return np.transpose(columns)


@given(postures, st.sampled_from(Foot))
def test_it_is_the_derivative_of_the_pose(q, fixed_foot):
    np.testing.assert_allclose(foot_jacobian(q, fixed_foot), by_differences(q, fixed_foot), atol=1e-8)


def test_at_zero():
    # foot B hangs 0.15 m beside foot A: q1's axis is -y at z = 0.025, q4's is z through the origin
    J = foot_jacobian(np.zeros(8), Foot.A)
    np.testing.assert_allclose(J[:, 0], [0.025, 0, 0.15, 0, -1, 0], atol=1e-15)
    np.testing.assert_allclose(J[:, 1], [0, 0, 1, 0, 0, 0], atol=1e-15)
    np.testing.assert_allclose(J[:, 3], [0, 0.15, 0, 0, 0, 1], atol=1e-15)
    np.testing.assert_allclose(J[:, 6], [0, 0, -1, 0, 0, 0], atol=1e-15)
    np.testing.assert_allclose(foot_jacobian(np.zeros(8), Foot.B)[:, 6], [0, 0, 1, 0, 0, 0], atol=1e-15)


@pytest.mark.parametrize("fixed_foot", Foot)
def test_many_postures_at_once(fixed_foot):
    q = random_postures(6).reshape(2, 3, 8)
    T, J = foot_and_jacobian(q, fixed_foot)
    assert J.shape == (2, 3, 6, 8)
    for index in np.ndindex(2, 3):
        np.testing.assert_allclose(J[index], foot_jacobian(q[index], fixed_foot), atol=1e-15)
        np.testing.assert_allclose(T[index], T_fixed_free(q[index], fixed_foot).matrix, atol=1e-15)


def test_rank_is_five_where_both_legs_turn_in_one_plane():
    in_plane = [-0.6, 0.0, 0.6, 0.0, 0.0, 0.6, 0.0, -0.6]
    aside = [-0.6, 0.0, 0.6, 0.4, 0.2, 0.6, 0.0, -0.6]
    assert np.linalg.matrix_rank(foot_jacobian(in_plane, Foot.A), tol=1e-9) == 5
    assert np.linalg.matrix_rank(foot_jacobian(aside, Foot.A), tol=1e-9) == 6
