import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays

from services.sim.motion import JointMotion, plan_motion

MAX_VELOCITY = np.array([1.0, 0.05])
SECOND = 1_000_000_000


def test_the_slowest_joint_sets_the_pace_and_all_arrive_together():
    motion = plan_motion(np.array([0.0, 0.0]), np.array([1.0, 0.1]), 5 * SECOND, MAX_VELOCITY)
    assert motion.duration_ns == 2 * SECOND
    q, dq = motion.at(6 * SECOND)
    np.testing.assert_allclose(q, [0.5, 0.05])
    np.testing.assert_allclose(dq, [0.5, 0.05])


def test_a_duration_is_kept_or_exceeded():
    start, end = np.zeros(2), np.array([1.0, 0.0])
    assert plan_motion(start, end, 0, MAX_VELOCITY, duration_s=4.0).duration_ns == 4 * SECOND
    assert plan_motion(start, end, 0, MAX_VELOCITY, duration_s=0.5).duration_ns == 1 * SECOND


def test_before_and_after_it_rests():
    motion = JointMotion(np.array([0.0]), np.array([0.3]), start_ns=10, duration_ns=10)
    for stamp_ns, position in ((0, 0.0), (20, 0.3), (30, 0.3)):
        q, dq = motion.at(stamp_ns)
        assert q == position
        assert dq == 0.0


def test_no_way_takes_no_time():
    motion = plan_motion(np.ones(2), np.ones(2), 7, MAX_VELOCITY)
    assert motion.duration_ns == 0
    np.testing.assert_array_equal(motion.at(7)[0], np.ones(2))


positions = arrays(np.float64, 2, elements=st.floats(-3, 3))


@given(positions, positions, st.floats(0, 10))
def test_no_joint_is_faster_than_its_limit(start, end, duration_s):
    motion = plan_motion(start, end, 0, MAX_VELOCITY, duration_s)
    _, dq = motion.at(motion.duration_ns // 2)
    assert (np.abs(dq) <= MAX_VELOCITY * (1 + 1e-9)).all()
    assert motion.duration_ns >= duration_s * SECOND


@given(positions, positions, positions, st.floats(0, 1))
def test_a_new_target_on_the_way_makes_no_jump(start, end, new_end, share):
    motion = plan_motion(start, end, 0, MAX_VELOCITY)
    stamp_ns = int(share * motion.duration_ns)
    q, _ = motion.at(stamp_ns)
    np.testing.assert_array_equal(plan_motion(q, new_end, stamp_ns, MAX_VELOCITY).at(stamp_ns)[0], q)


@pytest.mark.parametrize("duration_s", [1e-12, 86_400.0])
def test_extreme_durations_stay_integers(duration_s):
    assert isinstance(plan_motion(np.zeros(2), np.zeros(2), 0, MAX_VELOCITY, duration_s).duration_ns, int)


def test_with_ramps_it_speeds_up_and_slows_down_evenly():
    motion = plan_motion(np.zeros(2), np.array([1.0, -0.5]), 0, np.array([1.0, 1.0]), ramp_s=0.2)
    assert motion.duration_ns == 1_200_000_000
    shares = {0: 0.0, 100: 0.025, 200: 0.1, 600: 0.5, 1000: 0.9, 1100: 0.975, 1200: 1.0}
    for stamp_ms, share in shares.items():
        np.testing.assert_allclose(motion.at(stamp_ms * 1_000_000)[0], [share, -0.5 * share], atol=1e-12)
    velocities = [motion.at(stamp_ms * 1_000_000)[1][0] for stamp_ms in (0, 100, 200, 600, 1100)]
    np.testing.assert_allclose(velocities, [0.0, 0.5, 1.0, 1.0, 0.5], atol=1e-12)


def test_a_short_way_is_all_ramp_and_a_stream_has_none():
    short = plan_motion(np.zeros(1), np.array([0.01]), 0, np.ones(1), ramp_s=0.2)
    assert (short.duration_ns, short.ramp_ns) == (400_000_000, 200_000_000)
    streamed = plan_motion(np.zeros(1), np.array([0.01]), 0, np.ones(1), duration_s=0.1, ramp_s=0.2)
    assert (streamed.duration_ns, streamed.ramp_ns) == (100_000_000, 0)
    still = plan_motion(np.ones(1), np.ones(1), 0, np.ones(1), ramp_s=0.2)
    assert still.at(0)[0] == 1.0
