import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
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
