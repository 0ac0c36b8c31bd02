import pytest

from services.sim.sim_time import SimTime
from shared.errors import RefusedError
from shared.messaging.messages import SimAction, SimControl


def test_it_counts_periods_without_drift():
    time = SimTime(30.0, 1.0)
    assert time.advance() == (0, 33_333_333)
    for _ in range(59):
        time.advance()
    assert (time.stamp_ns, time.num_periods) == (2_000_000_000, 60)


def test_the_pace_is_that_of_rate_and_factor():
    time = SimTime(100.0, 0.5)
    assert (time.wall_hz, time.real_time_factor) == (50.0, 0.5)
    time.control(SimControl(real_time_factor=4.0))
    assert (time.wall_hz, time.real_time_factor) == (400.0, 4.0)


def test_paused_it_goes_on_by_single_steps_only():
    time = SimTime(10.0, 2.0)
    time.control(SimControl(action=SimAction.PAUSE))
    assert time.advance() is None
    assert time.real_time_factor == 0.0
    time.control(SimControl(action=SimAction.STEP))
    time.control(SimControl(action=SimAction.STEP, num_steps=2))
    assert [time.advance() is not None for _ in range(4)] == [True, True, True, False]
    assert time.stamp_ns == 300_000_000
    time.control(SimControl(action=SimAction.STEP, num_steps=5))
    time.control(SimControl(action=SimAction.PAUSE))
    assert time.advance() is None, "a pause ends the steps that are left"
    time.control(SimControl(action=SimAction.RESUME))
    assert time.advance() == (300_000_000, 400_000_000)
    assert time.real_time_factor == 2.0


@pytest.mark.parametrize(
    ("control", "reason"),
    [
        (SimControl(action=SimAction.STEP), "step needs a paused simulation: send pause first"),
        (SimControl(real_time_factor=0.0), "real_time_factor is 0, must be within 0.01..100"),
        (SimControl(real_time_factor=101.0), "real_time_factor is 101, must be within 0.01..100"),
        (SimControl(action=SimAction.STEP, num_steps=0), "num_steps is 0, must be within 1..1000000"),
        (SimControl(action=SimAction.STEP, num_steps=10**7), "num_steps is 10000000, must be within 1..1000000"),
    ],
)
def test_what_cannot_be_is_refused_and_changes_nothing(control, reason):
    time = SimTime(10.0, 1.0)
    with pytest.raises(RefusedError) as caught:
        time.control(control)
    assert str(caught.value) == reason
    assert time.real_time_factor == 1.0
    assert time.advance() is not None
