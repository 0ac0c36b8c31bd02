import re

import numpy as np
import pytest
from hypothesis import assume, given, settings, strategies as st

from shared.geometry import SE3
from shared.messaging.messages import Foot
from shared.robot.kinematics import T_fixed_free, T_footA_footB, foot_matrices
from shared.robot.reach import explain_unreachable, reach
from tests.support.postures import LOWER, UPPER, postures


@given(postures, st.sampled_from(Foot))
def test_reach_finds_a_posture_again_with_either_foot_fixed(q, fixed_foot):
    assume(not 0 < abs(np.sin(q[3] + q[4])) < 1e-6)  # there rounding alone can take a joint beyond its limit
    assume(not 0 < abs(np.cos(q[3])) < 1e-6)
    T = T_fixed_free(q, fixed_foot)
    found = reach(T, fixed_foot, LOWER, UPPER, q7=q[6], q8=q[7], alpha=q[0] + q[2])
    assert len(found)
    assert ((found >= LOWER) & (found <= UPPER)).all()
    for other in found:
        np.testing.assert_allclose(T_fixed_free(other, fixed_foot).matrix, T.matrix, atol=2e-8)


@pytest.mark.parametrize("fixed_foot", Foot)
def test_reach_spreads_the_free_joints_by_itself(fixed_foot):
    T = SE3.trans(x_m=0.3) if fixed_foot is Foot.A else SE3.trans(x_m=-0.3)
    found = reach(T, fixed_foot, LOWER, UPPER)
    assert len(found) > 100
    T_footA_footB = SE3.trans(x_m=0.3).matrix
    assert np.abs(foot_matrices(found) - T_footA_footB).max() < 1e-8
    assert np.ptp(found[:, 6]) > 0.02
    assert np.ptp(found[:, 7]) > 0.5


def test_reach_returns_both_wraps_of_the_hip():
    T = T_footA_footB([0.1, 0.0, -0.4, 3.15, 3.15, -0.8, 0.0, -0.4])
    found = reach(T, Foot.A, LOWER, UPPER, q7=0.0, q8=-0.4)
    wraps = {tuple(np.sign(q[3:5])) for q in found if abs(abs(q[3]) - np.pi) < 0.1}
    assert wraps == {(1, 1), (1, -1), (-1, 1), (-1, -1)}


def test_reach_of_what_is_too_far_is_empty():
    assert reach(SE3.trans(x_m=0.8), Foot.A, LOWER, UPPER).shape == (0, 8)


def test_farther_than_the_robot_is_long():
    # 4 x 0.025 of plates, 2 x 0.220 of legs, 0.150 of hip
    assert explain_unreachable(SE3.trans(x_m=0.8), Foot.A, LOWER, UPPER) == (
        "the free foot would be 0.8 m from the fixed one, 0.11 m farther than legs and hip are long together (0.69 m)"
    )


@pytest.mark.parametrize("fixed_foot", Foot)
def test_a_step_that_needs_longer_legs(fixed_foot):
    # both legs flat on the floor reach 2 (L0 + q) + t = 0.6 m with q2 + q7 = 0.060 m, of which q7 gives 0.025 m
    x_m = 0.6 if fixed_foot is Foot.A else -0.6
    reason = explain_unreachable(SE3.trans(x_m=x_m), fixed_foot, LOWER, UPPER)
    assert reason == "q2 would be 0.035 m, must be within -0.025..0.025 m"


def test_a_planar_goal_with_errors_is_reached_within_them():
    T = SE3.trans(x_m=0.3) @ SE3.rot("x", 1e-6) @ SE3.rot("z", 1e-6)
    found = reach(T, Foot.A, LOWER, UPPER, singular_rad=1e-5)
    assert len(found) > 100
    assert np.abs(foot_matrices(found) - T.matrix).max() < 1e-5
    assert len(reach(T, Foot.A, LOWER, UPPER)) < len(found)
    assert explain_unreachable(T, Foot.A, LOWER, UPPER, singular_rad=1e-5) == ""


def test_legs_without_pistons_are_reached_beside_the_grid():
    lower, upper = LOWER.copy(), UPPER.copy()
    lower[[1, 6]] = upper[[1, 6]] = 0.0
    T = T_fixed_free([0.3, 0.0, -0.2, 0.5, -0.9, 0.4, 0.0, 0.25], Foot.A) @ SE3.trans(z_m=-0.01)
    assert explain_unreachable(T, Foot.A, lower, upper) == ""
    (q,) = reach(T, Foot.A, lower, upper)
    np.testing.assert_allclose(T_footA_footB(q).matrix, T.matrix, atol=2e-10)
    assert q[1] == q[6] == 0


def test_a_joint_too_far_turned_is_named():
    # feet side by side, foot B pitched by 2.2 rad: q1 + q3 = -(q6 + q8) or so, with no joint allowed beyond 0.5 rad
    lower, upper = LOWER.copy(), UPPER.copy()
    lower[[0, 2, 5, 7]], upper[[0, 2, 5, 7]] = -0.5, 0.5
    T = SE3.trans(x_m=0.2, z_m=0.1) @ SE3.rot("y", 2.2)
    reason = explain_unreachable(T, Foot.A, lower, upper)
    assert "rad, must be within -0.5..0.5 rad" in reason
    assert len(reach(T, Foot.A, lower, upper)) == 0


def test_the_joints_named_are_as_little_beyond_as_can_be():
    # the pitch of 2.2 rad is the sum of four joints, of which none may be beyond 0.5 rad: 0.2 rad are missing
    lower, upper = LOWER.copy(), UPPER.copy()
    lower[[0, 2, 5, 7]], upper[[0, 2, 5, 7]] = -0.5, 0.5
    T = T_footA_footB([-0.7, 0.0, -0.5, 0.0, 0.0, -0.5, 0.0, -0.5])
    reason = explain_unreachable(T, Foot.A, lower, upper)
    missing = [abs(float(value)) - 0.5 for value in re.findall(r"would be (-?[\d.]+) rad", reason)]
    assert sum(missing) == pytest.approx(0.2, abs=2e-3)
    assert "q8" not in reason  # free, and so chosen within its limits


def test_full_turns_are_taken_off_beside_the_grid_too():
    q = np.array([0.3, 0.0, -0.2, 3.6, -4.0, 0.4, 0.0, 0.2567])
    lower, upper = LOWER.copy(), UPPER.copy()
    lower[[1, 6]] = upper[[1, 6]] = 0.0
    lower[3:5], upper[3:5] = (3.3, -4.2), (4.0, -3.4)
    (found,) = reach(T_footA_footB(q), Foot.A, lower, upper)
    np.testing.assert_allclose(T_footA_footB(found).matrix, T_footA_footB(q).matrix, atol=2e-10)
    assert explain_unreachable(T_footA_footB(q), Foot.A, lower, upper) == ""


def test_a_joint_is_named_with_the_turn_that_brings_it_nearest():
    # foot B stands aside so that q4 is 3.5 rad or pi - 3.5 + 2 pi = 5.92 rad; neither is inside
    lower, upper = LOWER.copy(), UPPER.copy()
    lower[3:5], upper[3:5] = (3.7, -4.2), (4.0, -3.4)
    reason = explain_unreachable(SE3.trans(0.1, 0.15 * np.sin(3.5), 0.0), Foot.A, lower, upper)
    assert reason == "q4 would be 3.5 rad, must be within 3.7..4 rad"


def test_farther_aside_than_the_hip_is_long():
    assert explain_unreachable(SE3.trans(y_m=0.4), Foot.A, LOWER, UPPER) == (
        "leg B would start farther from leg A's plane than the hip is long (0.15 m)"
    )


@settings(max_examples=25)
@given(st.floats(-0.4, 0.4), st.floats(-0.2, 0.2), st.floats(-0.4, 0.4), st.floats(-np.pi, np.pi))
def test_there_is_a_reason_only_where_nothing_is_found(x_m, y_m, z_m, yaw):
    T = SE3.trans(x_m, y_m, z_m) @ SE3.rot("z", yaw)
    if len(reach(T, Foot.A, LOWER, UPPER)):
        assert explain_unreachable(T, Foot.A, LOWER, UPPER) == ""
