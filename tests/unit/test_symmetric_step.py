import numpy as np
import pytest
from hypothesis import given, strategies as st

from shared.errors import RefusedError
from shared.geometry import SE3
from shared.robot.kinematics import T_footA_footB
from shared.robot.symmetric_step import symmetric_posture, symmetric_step


def test_the_wide_stand():
    # FACTS: (-.6, 0, .6, 0, 0, .6, 0, -.6) puts foot B 0.370211 m along x
    q = symmetric_posture(0.3702105646)
    np.testing.assert_allclose(q, [-0.6, 0, 0.6, 0, 0, 0.6, 0, -0.6], atol=1e-9)
    np.testing.assert_allclose(symmetric_step([-0.6, 0, 0.6, 0, 0, 0.6, 0, -0.6]), [0.3702105646, 0], atol=1e-9)


@given(st.floats(0.0, 0.45), st.floats(-1.0, 1.0), st.floats(-0.025, 0.025))
def test_foot_b_is_a_step_away(step_m, pitch_rad, extension_m):
    q = symmetric_posture(step_m, pitch_rad, extension_m)
    np.testing.assert_allclose(symmetric_step(q), (step_m, pitch_rad), atol=1e-12)
    T = SE3.trans(x_m=step_m * np.cos(pitch_rad / 2), z_m=-step_m * np.sin(pitch_rad / 2)) @ SE3.rot("y", pitch_rad)
    np.testing.assert_allclose(T_footA_footB(q).matrix, T.matrix, atol=1e-12)
    assert q[1] == extension_m


def test_many_at_once():
    q = np.stack([symmetric_posture(0.2), symmetric_posture(0.3, 0.4)])
    np.testing.assert_allclose(symmetric_step(q), [[0.2, 0.3], [0.0, 0.4]], atol=1e-12)


def test_a_step_longer_than_the_legs_is_refused():
    with pytest.raises(RefusedError, match=r"a step of 0\.6 m with a pitch of 0 rad needs legs of 0\.225 m, they are"):
        symmetric_posture(0.6)
    with pytest.raises(RefusedError, match=r"they are 0\.22 m where q2 and q7 are 0\.025 m"):
        symmetric_posture(0.6, extension_m=0.025)
    with pytest.raises(RefusedError):
        symmetric_posture(np.nan)


def test_a_posture_that_is_not_symmetric_is_refused():
    with pytest.raises(ValueError, match=r"q must be \(q1, q2, q3, 0, 0, q3, q2, q1\)"):
        symmetric_step([-0.6, 0, 0.6, 0, 0, 0.6, 0, -0.5])
    with pytest.raises(ValueError, match="q must be"):
        symmetric_step([-0.6, 0, 0.6, 0.1, 0, 0.6, 0, -0.6])
