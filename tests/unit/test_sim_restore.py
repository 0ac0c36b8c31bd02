"""A simulation that was killed goes on where it was, to the number."""

import itertools

import numpy as np
import pytest

from services.sim.state import SimState
from shared.errors import RefusedError
from shared.geometry import SE3
from shared.messaging.codec import decode, encode
from shared.messaging.messages import (
    Clock,
    Event,
    Foot,
    JointState,
    JointTarget,
    LegState,
    LegTarget,
    Measurement,
    SimAction,
    SimControl,
    Stop,
    Transforms,
)
from shared.runtime.config import EncoderConfig, SimConfig, SlipConfig
from tests.support.robots import NOTHING, ORIGINAL, events, last, only, run, running

NOISY = SimConfig(encoders=EncoderConfig(bias_rad=0.01, noise_rad=0.002), slip=SlipConfig(slide_m=0.003))
Q = np.array([0.3, 0.02, -0.4, 0.1, 0.2, -0.1, 0.02, 0.5])

STRIDE = np.array([-0.673847, 0.025, 0.673847, 0.257706, -0.519505, 0.805398, 0.009834, -0.805398])
"""The first row of the climb."""


def through_a_file(sim) -> SimState:
    return decode(SimState, encode(sim.snapshot()))


def poses(transforms):
    return np.array([SE3.from_xyz_quat_xyzw(row).matrix for row in transforms.T_parent_child])


def climbed(sim, seconds=2.0):
    sim.start()
    sim.set_joint_target(JointTarget(q=Q, duration_s=1.0))
    run(sim, seconds)
    return [*sim.set_fixed_foot(LegTarget(foot=Foot.B)), *run(sim, 0.05)]


def test_it_stands_where_it_stood_and_time_goes_on():
    with running(NOISY, seed=3) as sim, running(NOISY, seed=99) as again:
        before = climbed(sim)
        (event,) = again.restore(through_a_file(sim))
        assert "restored at 2.06 s: foot B is fixed" in event.text
        after = again.start()
        np.testing.assert_allclose(poses(only(Transforms, after)), poses(last(Transforms, before)), rtol=0, atol=1e-9)
        assert only(LegState, after).fixed_foot is Foot.B
        assert only(Clock, after).stamp_ns == last(Clock, before).stamp_ns + 10_000_000


def test_no_stamp_and_no_number_is_used_twice_or_left_out():
    with running() as sim, running() as again:
        before = climbed(sim)
        again.restore(through_a_file(sim))
        after = [*again.start(), *run(again, 0.5)]
        for kind in (JointState, Transforms, Clock, LegState):
            old, new = (last(kind, before), [each for each in after if type(each) is kind])
            assert [each.seq for each in new] == list(range(old.seq + 1, old.seq + 1 + len(new)))
            assert all(a.stamp_ns < b.stamp_ns for a, b in itertools.pairwise([old, *new]))
        assert all(each.stamp_ns > 2_050_000_000 for each in after if isinstance(each, Measurement))


def test_bias_and_noise_go_on():
    with running(NOISY, seed=3) as sim, running(NOISY, seed=99) as again:
        climbed(sim)
        again.restore(through_a_file(sim))
        again.start()  # reads the encoders once, as the next step of the other does
        sim.step()
        assert np.array_equal(only(JointState, sim.step()).q, only(JointState, again.step()).q)
        for each in (sim, again):
            each.set_fixed_foot(LegTarget(foot=Foot.A))
        stands = [only(Transforms, each.step()).T_parent_child for each in (sim, again)]
        np.testing.assert_allclose(*stands, rtol=0, atol=1e-9)


def test_what_was_under_way_is_halted_and_the_next_target_is_taken():
    with running() as sim, running() as again:
        sim.start()
        sim.set_joint_target(JointTarget(q=Q, duration_s=2.0))
        q = last(JointState, run(sim, 1.0)).q
        again.restore(through_a_file(sim))
        np.testing.assert_allclose(last(JointState, run(again, 1.0)).q, q, atol=1e-12)
        np.testing.assert_allclose(q, Q / 2, atol=1e-9)
        again.set_joint_target(JointTarget(q=Q, duration_s=0.5))
        np.testing.assert_allclose(last(JointState, run(again, 1.0)).q, Q)


def test_a_pause_a_pace_and_a_stop_hold_on():
    with running() as sim, running() as again:
        climbed(sim)
        sim.control(SimControl(real_time_factor=2.0))
        sim.control(SimControl(action=SimAction.PAUSE))
        sim.stop(Stop())
        again.restore(through_a_file(sim))
        assert again.step() == []
        assert again.wall_hz == 200.0
        with pytest.raises(RefusedError, match="was stopped"):
            again.set_joint_target(JointTarget(q=Q))


@pytest.mark.parametrize("seconds", [0.1, 2.0])
def test_a_dynamic_robot_hangs_on_at_rest(seconds):
    config = SimConfig(mode="dynamic")
    with running(config, ORIGINAL) as sim, running(config, ORIGINAL) as again:
        sim.start()
        sim.set_joint_target(JointTarget(q=STRIDE, duration_s=3.0))
        before = last(JointState, run(sim, seconds))
        foot = last(LegState, run(sim, 0.1))
        state = through_a_file(sim)
        again.restore(state)
        said = run(again, 1.0)
        after = last(JointState, said)
        assert events(said) == []
        assert np.abs(after.dq).max() < 1e-3
        assert np.abs(after.q - state.body.q).max() < 2e-3
        assert last(LegState, said).holding == (Foot.A,)
        np.testing.assert_allclose(last(LegState, said).T_world_foot, foot.T_world_foot, atol=1e-4)
        assert seconds < 1 or np.abs(before.dq).max() > 0.05


def test_a_dynamic_change_of_foot_goes_on():
    config = SimConfig(mode="dynamic")
    with running(config, NOTHING) as sim, running(config, NOTHING) as again:
        sim.start()
        run(sim, 0.1)
        again.restore(through_a_file(sim))
        said = run(again, 0.5)
        assert not [each for each in said if isinstance(each, Event)], "a fall was said before"


def test_a_state_that_is_none_of_this_simulation_s_is_refused():
    with running() as sim:
        plain = {name: getattr(sim.snapshot(), name) for name in SimState.__slots__}
        for wrong in ({"num_sent": np.zeros(3)}, {"encoder_rng": "{}"}, {"slip_rng": "no"}):
            with pytest.raises(ValueError, match=r"."):
                sim.restore(SimState(**(plain | wrong)))
