import numpy as np
import pytest
from hypothesis import given, strategies as st

from shared.robot.adhesion import MagnetLimits, margin, overload

LIMITS = MagnetLimits()
ROUND = MagnetLimits(pull_n=100.0, half_width_m=0.05, friction=0.5)

loads = st.tuples(*[st.floats(-300, 300)] * 3, *[st.floats(-20, 20)] * 3)


def test_33_kg_over_half_a_foot_bear_16_2_nm():
    # FACTS section 1, Holding
    assert LIMITS.pull_n == pytest.approx(33 * 9.81, abs=0.05)
    assert margin([0, 0, 0, 16.185, 0, 0], LIMITS) == pytest.approx(0, abs=1e-12)
    assert overload([0, 0, 0, 16.18, 0, 0], LIMITS) is None
    assert overload([0, 0, 0, 0, -16.3, 0], LIMITS) == "tilt is 16.3 Nm, must be at most 16.18 Nm with 0 N of pressure"


@pytest.mark.parametrize(
    ("wrench", "expected"),
    [
        ([0, 0, 0, 0, 0, 0], 1.0),
        ([0, 0, -25, 0, 0, 0], 0.75),  # a quarter of the pull
        ([0, 0, -100, 0, 0, 0], 0.0),
        ([0, 0, -150, 0, 0, 0], -0.5),
        ([0, 0, 80, 0, 0, 0], 1.0),  # pressed on
        ([0, 0, 0, 2.5, 0, 0], 0.5),  # 2.5 Nm of 5 Nm
        ([0, 0, 0, 2.5, -2.5, 0], 0.5),  # a square: each pair of edges by itself
        ([0, 0, -25, 2.5, 0, 0], 0.25),
        ([0, 0, 50, 5.0, 0, 0], 0.5),  # pressure helps
        ([15, -20, 0, 0, 0, 0], 0.5),  # 25 N of 50 N
        ([15, 20, -25, 0, 0, 0], 0.25),
        ([0, 0, 0, 0, 0, 25 * ROUND.twist_radius_m], 0.5),
        ([25, 0, 0, 0, 0, -25 * ROUND.twist_radius_m], 0.0),
    ],
)
def test_margins(wrench, expected):
    assert margin(wrench, ROUND) == pytest.approx(expected, abs=1e-12)


def test_the_radius_of_twist_is_the_mean_distance_from_the_centre():
    cells = (np.arange(400) + 0.5) / 400 * 2 - 1
    mean = np.hypot(*np.meshgrid(cells, cells)).mean()
    assert ROUND.twist_radius_m / ROUND.half_width_m == pytest.approx(mean, abs=1e-5)
    assert mean == pytest.approx(0.7652, abs=1e-4)


@pytest.mark.parametrize(
    ("wrench", "text"),
    [
        ([0, 0, -120, 3, 0, 0], "pull is 120 N, must be at most 100 N"),
        ([0, 0, -20, 4.5, 0, 0], "tilt is 4.5 Nm, must be at most 4 Nm with 20 N of pull"),
        ([0, 0, -95, 3, 0, 0], "tilt is 3 Nm, must be at most 0.25 Nm with 95 N of pull"),
        ([20, 0, 0, 5.5, 0, 0], "tilt is 5.5 Nm, must be at most 5 Nm with 0 N of pressure"),
        ([0, 0, 20, 0, 6.5, 0], "tilt is 6.5 Nm, must be at most 6 Nm with 20 N of pressure"),
        ([60, 0, -20, 0, 0, 0], "shear with twist is 60 N, must be at most 40 N with 20 N of pull"),
    ],
)
def test_what_is_beyond_is_named(wrench, text):
    assert overload(wrench, ROUND) == text


@given(loads, st.floats(0.01, 3))
def test_utilisation_is_proportional_to_the_load(wrench, factor):
    scaled = 1 - margin(factor * np.array(wrench), ROUND)
    np.testing.assert_allclose(scaled, factor * (1 - margin(wrench, ROUND)), rtol=1e-9, atol=1e-12)


@given(loads)
def test_a_foot_holds_exactly_where_all_three_limits_do(wrench):
    fx, fy, fz, mx, my, mz = wrench
    contact_n = 100.0 + fz
    excess = max(
        max(abs(mx), abs(my)) - contact_n * 0.05,
        np.hypot(fx, fy) + abs(mz) / ROUND.twist_radius_m - 0.5 * contact_n,
        -contact_n,
    )
    if abs(excess) > 1e-9:
        assert (margin(wrench, ROUND) >= 0) == (excess < 0)
        assert (overload(wrench, ROUND) is None) == (excess < 0)


def test_many_at_once_and_wrong_shapes():
    wrenches = np.random.default_rng(1).normal(size=(4, 5, 6)) * 30
    assert margin(wrenches, LIMITS).shape == (4, 5)
    assert margin(wrenches, LIMITS)[2, 3] == margin(wrenches[2, 3], LIMITS)
    with pytest.raises(ValueError, match=r"wrench must be \(\.\.\., 6\), got \(5,\)"):
        margin(np.zeros(5), LIMITS)
    with pytest.raises(ValueError, match=r"wrench must be \(6,\), got \(2, 6\)"):
        overload(np.zeros((2, 6)), LIMITS)
