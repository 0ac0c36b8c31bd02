import pytest
from hypothesis import given, strategies as st

from shared.robot.ramps import ramped_share


@pytest.mark.parametrize(
    ("elapsed", "share", "rate"),
    [
        (-1, 0, 0),
        (0.1, 0.0125, 0.25),
        (0.2, 0.05, 0.5),
        (1.1, 0.5, 0.5),
        (2.0, 0.95, 0.5),
        (2.1, 0.9875, 0.25),
        (3, 1, 0),
    ],
)
def test_a_motion_of_two_point_two_seconds_with_ramps_of_two_tenths(elapsed, share, rate):
    assert ramped_share(elapsed, 2.2, 0.2) == pytest.approx((share, rate))


def test_without_a_ramp_it_is_even():
    assert ramped_share(0.25, 1.0, 0.0) == (0.25, 1.0)


@given(st.floats(0.01, 100), st.floats(0, 0.5), st.floats(0, 1))
def test_it_is_symmetric_and_its_rate_is_its_slope(total, ramp_share, at):
    ramp, elapsed = ramp_share * total, at * total
    share, _ = ramped_share(elapsed, total, ramp)
    assert share == pytest.approx(1 - ramped_share(total - elapsed, total, ramp)[0], abs=1e-9)
    step = 1e-6 * total
    before, after = (ramped_share(elapsed + sign * step, total, ramp)[0] for sign in (-1, 1))
    if step < elapsed < total - step and min(abs(elapsed - ramp), abs(total - ramp - elapsed)) > step:
        assert (after - before) / (2 * step) == pytest.approx(ramped_share(elapsed, total, ramp)[1], rel=1e-3, abs=1e-6)
