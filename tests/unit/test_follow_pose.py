import time

import numpy as np
import pytest
from hypothesis import given, strategies as st

from shared.geometry import SE3
from shared.messaging.messages import Foot
from shared.robot.follow_pose import _bounded_step, follow_pose
from shared.robot.jacobian import foot_jacobian
from shared.robot.kinematics import IS_PRISMATIC, T_fixed_free
from tests.support.postures import LOWER, UPPER, postures, random_postures

WIDE = np.array([-0.6, 0.0, 0.6, 0.0, 0.0, 0.6, 0.0, -0.6])


@given(postures, st.sampled_from(Foot), st.integers(0, 2**32 - 1))
def test_a_pose_nearby_is_met_by_a_posture_nearby(q, fixed_foot, seed):
    noise = np.random.default_rng(seed).uniform(-0.01, 0.01, 8) * np.where(IS_PRISMATIC, 0.2, 1.0)
    goal = T_fixed_free(np.clip(q + noise, LOWER, UPPER), fixed_foot)
    found = follow_pose(q, goal, fixed_foot, LOWER, UPPER)
    if found is None:  # between limits and a singularity a step can need a long way round
        assert np.abs(np.sin(q[3] + q[4])) < 0.1 or not ((q > LOWER + 0.01) & (q < UPPER - 0.01)).all()
        return
    np.testing.assert_allclose(T_fixed_free(found, fixed_foot).matrix, goal.matrix, atol=2e-10)
    assert ((found >= LOWER) & (found <= UPPER)).all()


def test_nearly_every_pose_nearby_is_met():
    rng = np.random.default_rng(2)
    starts = random_postures(300)
    goals = np.clip(starts + rng.normal(size=starts.shape) * np.where(IS_PRISMATIC, 0.002, 0.01), LOWER, UPPER)
    found = [
        follow_pose(q, T_fixed_free(goal, Foot.B), Foot.B, LOWER, UPPER) for q, goal in zip(starts, goals, strict=True)
    ]
    moved = [np.abs(q - start).max() for q, start in zip(found, starts, strict=True) if q is not None]
    assert len(moved) >= 299
    assert max(moved) < 0.06


@pytest.mark.parametrize("fixed_foot", Foot)
def test_a_foot_moves_along_a_line_in_the_plane_of_the_legs(fixed_foot):
    q, T = WIDE, T_fixed_free(WIDE, fixed_foot)
    began_s = time.perf_counter()
    for height_m in np.linspace(0, 0.06, 61):
        goal = SE3.trans(z_m=height_m) @ T
        q_next = follow_pose(q, goal, fixed_foot, LOWER, UPPER)
        assert q_next is not None
        np.testing.assert_allclose(T_fixed_free(q_next, fixed_foot).matrix, goal.matrix, atol=2e-10)
        assert np.abs(q_next - q).max() < 0.03
        q = q_next
    assert time.perf_counter() - began_s < 61 * 0.02  # 0.4 ms each alone on a core


def test_joints_at_their_limits_wait_while_others_go_on():
    # straight up with legs that can hardly change their length: the revolute joints do it
    lower, upper = LOWER.copy(), UPPER.copy()
    lower[1], upper[1], lower[6], upper[6] = -0.001, 0.001, 0.0, 0.0
    goal = SE3.trans(z_m=0.03) @ T_fixed_free(WIDE, Foot.A)
    found = follow_pose(WIDE, goal, Foot.A, lower, upper)
    np.testing.assert_allclose(T_fixed_free(found, Foot.A).matrix, goal.matrix, atol=2e-10)
    assert found[6] == 0.0
    assert abs(found[1]) <= 0.001


@given(st.integers(0, 2**32 - 1))
def test_a_step_along_limits_removes_the_whole_error(seed):
    rng = np.random.default_rng(seed)
    J = foot_jacobian(random_postures(1, seed)[0], Foot.A)
    error = J @ np.where(IS_PRISMATIC, 0.002, 0.01)
    free = _bounded_step(J, error, np.full(8, -1.0), np.full(8, 1.0), 1e-14)
    limits = np.full(8, 1.0)
    joint = rng.integers(8)
    limits[joint] = abs(free[joint]) / 2
    step = _bounded_step(J, error, -limits, limits, 1e-14)
    assert (np.abs(step) <= limits + 1e-15).all()
    if np.linalg.svd(np.delete(J, joint, axis=1))[1][-1] > 0.01 and np.abs(step).max() < 0.09:
        assert abs(step[joint]) == pytest.approx(limits[joint])
        np.testing.assert_allclose(J @ step, error, atol=1e-9)


def test_pistons_and_turns_share_a_step_by_what_they_move():
    # 10 mm up: a leg's metre counts as much as 0.195 m of arc, so pistons do not do it all
    found = follow_pose(WIDE, SE3.trans(z_m=0.01) @ T_fixed_free(WIDE, Foot.A), Foot.A, LOWER, UPPER)
    assert np.abs(found - WIDE)[[1, 6]].max() < 0.004


def test_far_poses_are_often_met_too():
    starts, goals = random_postures(100, 3), random_postures(100, 4)
    poses = [T_fixed_free(q, Foot.A) for q in goals]
    found = [follow_pose(q, T, Foot.A, LOWER, UPPER) for q, T in zip(starts, poses, strict=True)]
    met = [(q, T) for q, T in zip(found, poses, strict=True) if q is not None]
    assert len(met) > 25
    for q, T in met:
        np.testing.assert_allclose(T_fixed_free(q, Foot.A).matrix, T.matrix, atol=2e-10)


def test_where_it_is_already_nothing_moves():
    np.testing.assert_array_equal(follow_pose(WIDE, T_fixed_free(WIDE, Foot.A), Foot.A, LOWER, UPPER), WIDE)


def test_a_roll_that_the_plane_of_the_legs_cannot_make_is_let_pass_within_the_tolerance():
    goal = T_fixed_free(WIDE, Foot.A) @ SE3.trans(z_m=0.01) @ SE3.rot("x", 1e-8)
    assert follow_pose(WIDE, goal, Foot.A, LOWER, UPPER) is None
    found = follow_pose(WIDE, goal, Foot.A, LOWER, UPPER, tolerance=2e-8)
    np.testing.assert_allclose(T_fixed_free(found, Foot.A).matrix, goal.matrix, atol=2e-8)


@pytest.mark.parametrize("goal", [SE3.trans(x_m=0.8), SE3.trans(x_m=0.37) @ SE3.rot("x", np.pi)])
def test_what_cannot_be_met_is_none(goal):
    assert follow_pose(WIDE, goal, Foot.A, LOWER, UPPER) is None


def test_half_a_turn_is_an_error_too():
    start = np.array([0.3, 0.02, -0.2, 0.5, -0.9, 0.4, -0.01, 0.25])
    for axis in "xyz":
        goal = T_fixed_free(start, Foot.A) @ SE3.rot(axis, np.pi)
        found = follow_pose(start, goal, Foot.A, LOWER, UPPER)
        assert found is None or np.abs(T_fixed_free(found, Foot.A).matrix - goal.matrix).max() < 2e-10
