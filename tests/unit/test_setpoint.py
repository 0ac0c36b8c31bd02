import numpy as np
import pytest

from services.sim.setpoint import Setpoint

STEP_S = 0.001
ONE = np.ones(8)


def followed(commands, max_velocity=1.0, max_acceleration=5.0):
    """Positions and velocities (N, 8) of a setpoint that starts at rest at zero."""
    setpoint = Setpoint(max_velocity * ONE, max_acceleration * ONE, bandwidth_hz=10.0)
    rows = []
    for q, dq in commands:
        setpoint.follow(q * ONE, dq * ONE, STEP_S)
        rows.append((setpoint.q, setpoint.dq))
    return np.array([q for q, _ in rows]), np.array([dq for _, dq in rows])


def ramp(speed, seconds, rest_s=1.0):
    times = np.arange(STEP_S, seconds + rest_s, STEP_S)
    return [(speed * min(t, seconds), speed if t < seconds else 0.0) for t in times]


@pytest.mark.parametrize("speed", [0.05, 0.3, 1.0])
def test_it_keeps_its_limits_and_arrives(speed):
    q, dq = followed(ramp(speed, 1.0))
    assert np.abs(np.diff(dq, axis=0)).max() <= 5.0 * STEP_S + 1e-12
    assert dq.max() <= 1.0 + 1e-12
    assert q[-1] == pytest.approx(speed * ONE, abs=1e-9)
    assert q.max() <= speed + speed**2 / (2 * 5.0) + 1e-3, "it cannot stop at once"


def test_it_follows_a_steady_command_without_lag():
    q, _ = followed(ramp(0.3, 1.0, rest_s=0.0))
    assert q[-1, 0] == pytest.approx(0.3, abs=2e-4)
    lag = np.array([command for command, _ in ramp(0.3, 1.0, rest_s=0.0)]) - q[:, 0]
    assert lag.max() < 0.3**2 / (2 * 5.0) + 1e-3


def test_a_jump_of_the_command_is_taken_at_the_limits():
    q, dq = followed([(1.0, 0.0)] * 2000)
    assert dq.max() == pytest.approx(1.0)
    assert q[-1, 0] == pytest.approx(1.0, abs=1e-6)
    assert q.max() < 1.002


def test_a_reset_stands_still():
    setpoint = Setpoint(ONE, ONE, 10.0)
    setpoint.follow(ONE, ONE, STEP_S)
    setpoint.reset(0.5 * ONE)
    np.testing.assert_array_equal([setpoint.q, setpoint.dq], [0.5 * ONE, 0 * ONE])
