import dataclasses

import numpy as np
import pytest

from shared.messaging.messages import JOINT_NAMES
from shared.robot.limits import JOINT_UNITS, beyond_limits, joint_bounds, wraps_within
from tests.support.postures import LOWER, MODEL, UPPER


def test_bounds_are_in_the_order_of_the_joints():
    np.testing.assert_array_equal(UPPER, [1.5708, 0.025, 1.5708, 3.2, 3.2, 1.5708, 0.025, 1.5708])
    np.testing.assert_array_equal(LOWER, -UPPER)


def test_a_model_without_a_joint_is_refused():
    without = dataclasses.replace(MODEL, joints=tuple(joint for joint in MODEL.joints if joint.name != "q4"))
    with pytest.raises(ValueError, match="robot 'hyrecro' has no joint q4; joints are q1, q2, q3, q5"):
        joint_bounds(without)


def test_what_is_beyond_a_limit_is_named():
    q = [0.0, 0.0832, 0.0, 0.0, -3.3, 0.0, 0.025, np.nan]
    assert beyond_limits(JOINT_NAMES, q, LOWER, UPPER, JOINT_UNITS) == [
        "q2 is 0.0832 m, must be within -0.025..0.025 m",
        "q5 is -3.3 rad, must be within -3.2..3.2 rad",
        "q8 is nan rad, must be within -1.5708..1.5708 rad",
    ]
    assert beyond_limits(JOINT_NAMES, np.zeros(8), LOWER, UPPER, JOINT_UNITS) == []


def test_turns_that_fit_the_limits():
    q = np.array([0.1 + 2 * np.pi, 0.0, -0.2, 3.1, 0.5, 0.0, 0.0, 0.0])
    found = wraps_within(q, LOWER, UPPER)
    assert found.shape == (2, 8)
    np.testing.assert_allclose(sorted(found[:, 3]), [3.1 - 2 * np.pi, 3.1])
    np.testing.assert_allclose(found[:, [0, 2, 4]], [[0.1, -0.2, 0.5]] * 2, atol=1e-14)


def test_a_rounding_error_beyond_a_limit_is_set_to_the_limit():
    q = np.zeros((3, 8))
    q[:, 1] = 0.025 + 1e-10, 0.0251, np.nan
    found = wraps_within(q, LOWER, UPPER)
    np.testing.assert_array_equal(found[:, 1], [0.025])


def test_pistons_do_not_wrap():
    assert len(wraps_within([0, 2 * np.pi, 0, 0, 0, 0, 0, 0], LOWER, UPPER)) == 0
