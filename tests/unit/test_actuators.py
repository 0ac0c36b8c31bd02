import numpy as np
import pytest

from shared.robot.actuators import (
    ACTUATOR_NAMES,
    ActuatorGeometry,
    actuator_refusals,
    actuators_from_joints,
    joints_from_actuators,
)
from tests.support.postures import random_postures

REMEMBERED = ActuatorGeometry(core_link_m=0.16)
MID_STROKE = np.array([0.22] * 4 + [0.0] * 2 + [0.22] * 4)


def test_mid_stroke_is_zero():
    q, slides_m = joints_from_actuators(MID_STROKE)
    np.testing.assert_allclose(q, np.zeros(8), atol=1e-15)
    np.testing.assert_array_equal(slides_m, [0, 0])
    np.testing.assert_allclose(actuators_from_joints(np.zeros(8)), MID_STROKE, atol=1e-15)


def test_a_posture_that_moves_every_actuator():
    # an independent implementation, with the core link of the papers
    q = [-0.3, 0.03, 0.3, 0.4, -0.2, 0.25, 0.05, -0.35]
    expected = {
        "a1_l": 0.180688024097,
        "a1_r": 0.204328618694,
        "a2_l": 0.204328618694,
        "a2_r": 0.180688024097,
        "th_a": 0.4,
        "th_b": -0.2,
        "b2_l": 0.212399798471,
        "b2_r": 0.192607855786,
        "b1_l": 0.188799663236,
        "b1_r": 0.216229511861,
    }
    assert tuple(expected) == ACTUATOR_NAMES
    values = actuators_from_joints(q, geometry=REMEMBERED)
    np.testing.assert_allclose(values, list(expected.values()), atol=1e-12)
    np.testing.assert_allclose(joints_from_actuators(values, REMEMBERED)[0], q, atol=1e-12)


def test_a_core_link_that_slides_moves_no_joint():
    slides_m = np.array([0.02, -0.01])
    values = actuators_from_joints(np.zeros(8), slides_m)
    np.testing.assert_allclose(values, [0.23, 0.23, 0.21, 0.21, 0, 0, 0.225, 0.225, 0.215, 0.215], atol=1e-15)
    q, found_m = joints_from_actuators(values)
    np.testing.assert_allclose(q, np.zeros(8), atol=1e-15)
    np.testing.assert_allclose(found_m, slides_m, atol=1e-15)


def test_actuators_come_back():
    rng = np.random.default_rng(1)
    values = rng.uniform(0.19, 0.25, (20_000, 10))
    q, slides_m = joints_from_actuators(values)
    np.testing.assert_allclose(actuators_from_joints(q, slides_m), values, rtol=0, atol=1e-12)
    assert not actuator_refusals(values[0])


def test_joints_come_back():
    q = random_postures(20_000)
    q[:, [0, 2, 5, 7]] *= 0.85  # as far as 76 degrees; the strokes end at 49
    slides_m = np.random.default_rng(2).uniform(-0.03, 0.03, (20_000, 2))
    found, found_m = joints_from_actuators(actuators_from_joints(q, slides_m))
    np.testing.assert_allclose(found, q, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found_m, slides_m, rtol=0, atol=1e-12)


def test_the_two_slides_are_all_that_joints_do_not_show():
    step = 1e-7
    columns = [
        np.concatenate(joints_from_actuators(MID_STROKE + move)) - np.concatenate(joints_from_actuators(MID_STROKE))
        for move in step * np.eye(10)
    ]
    jacobian = np.transpose(columns) / step
    assert np.linalg.matrix_rank(jacobian, tol=1e-3) == 10
    assert np.linalg.matrix_rank(jacobian[:8], tol=1e-3) == 8


def test_pistons_beyond_their_stroke_are_named():
    values = MID_STROKE.copy()
    values[[0, 7]] = 0.2612, 0.18
    assert actuator_refusals(values) == [
        "a1_l is 0.2612 m, must be within 0.19..0.25 m",
        "b2_r is 0.18 m, must be within 0.19..0.25 m",
    ]
    assert actuator_refusals(MID_STROKE) == []


def test_pistons_that_do_not_close_are_named():
    values = MID_STROKE.copy()
    values[[8, 9]] = 0.5, 0.1
    assert actuator_refusals(values)[2:] == ["b1_l and b1_r are 0.5 and 0.1 m, with which the module does not close"]
    q, _ = joints_from_actuators(values)
    np.testing.assert_array_equal(np.isnan(q), [False] * 6 + [True] * 2)


def test_wrong_numbers_of_values_are_refused():
    with pytest.raises(ValueError, match=r"actuator values must be \(\.\.\., 10\), got \(8,\)"):
        joints_from_actuators(np.zeros(8))
    with pytest.raises(ValueError, match=r"actuator values must be \(10,\), got \(2, 10\)"):
        actuator_refusals(np.zeros((2, 10)))
