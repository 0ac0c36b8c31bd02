import numpy as np
import pytest

from shared.errors import RefusedError
from shared.messaging.messages import (
    ActuatorState,
    ActuatorTarget,
    Clock,
    Event,
    JointState,
    JointTarget,
    LegState,
    Severity,
    SimAction,
    SimControl,
)
from shared.robot.actuators import actuators_from_joints
from shared.runtime.config import ActuatorConfig, EncoderConfig, SimConfig
from tests.support.robots import events, last, only, run, running


def test_at_rest_the_pistons_are_at_mid_stroke():
    with running() as sim:
        state = only(ActuatorState, sim.start())
    np.testing.assert_allclose(state.positions, [0.22] * 4 + [0, 0] + [0.22] * 4, atol=1e-15)
    np.testing.assert_array_equal(state.velocities, np.zeros(10))


def test_actuators_move_the_joints_and_arrive_together():
    goal = np.array([0.225, 0.215, 0.222, 0.218, 0.3, -0.2, 0.221, 0.219, 0.22, 0.23])
    with running() as sim:
        sim.start()
        assert sim.set_actuator_target(ActuatorTarget(positions=goal, duration_s=2.0)) == []
        halfway, end = (last(ActuatorState, run(sim, 1.0)) for _ in range(2))
        joints = only(JointState, sim.step())
    np.testing.assert_allclose(end.positions, goal, atol=1e-12)
    np.testing.assert_allclose(actuators_from_joints(joints.q, [0.0, 0.0])[4:6], goal[4:6])
    assert joints.q[1] != 0.0
    np.testing.assert_allclose(halfway.velocities[4:6], [0.15, -0.1], atol=1e-12)


def test_the_core_link_slides_and_nothing_else_moves():
    slid = {"names": ("a1_l", "a1_r", "a2_l", "a2_r"), "positions": np.array([0.23, 0.23, 0.21, 0.21])}
    with running() as sim:
        sim.start()
        sim.set_actuator_target(ActuatorTarget(**slid))
        messages = run(sim, 1.0)
        sim.set_joint_target(JointTarget(q=np.array([0.1]), names=("q4",)))
        later = last(ActuatorState, run(sim, 1.0))
    np.testing.assert_allclose(last(JointState, messages).q, np.zeros(8), atol=1e-12)
    np.testing.assert_allclose(last(ActuatorState, messages).positions[:4], [0.23, 0.23, 0.21, 0.21], atol=1e-12)
    np.testing.assert_allclose(later.positions[:5], [0.23, 0.23, 0.21, 0.21, 0.1], atol=1e-12)


@pytest.mark.parametrize(
    ("target", "reason"),
    [
        ({"positions": np.full(9, 0.22)}, "positions has 9 values, 10 expected (a1_l, a1_r, a2_l"),
        ({"positions": np.array([0.2]), "names": ("a3_l",)}, "unknown actuator 'a3_l'; actuators are a1_l, a1_r"),
        ({"positions": np.array([0.26]), "names": ("b2_r",)}, "b2_r is 0.26 m, must be within 0.19..0.25 m"),
        ({"positions": np.array([4.0]), "names": ("th_a",)}, "q4 would be 4 rad, must be within -3.2..3.2 rad"),
        (
            {"positions": np.array([0.24] * 4), "names": ("a1_l", "a1_r", "a2_l", "a2_r")},
            "q2 would be 0.04 m, must be within -0.025..0.025 m",
        ),
        ({"positions": np.array([0.2]), "names": ("a1_l",), "duration_s": 0.0}, "duration_s is 0, must be above 0"),
    ],
)
def test_a_refused_target_says_why_and_changes_nothing(target, reason):
    with running() as sim:
        before = only(ActuatorState, sim.start())
        with pytest.raises(RefusedError) as caught:
            sim.set_actuator_target(ActuatorTarget(**target))
        assert str(caught.value).startswith(reason)
        np.testing.assert_array_equal(last(ActuatorState, run(sim, 0.5)).positions, before.positions)


def test_joint_commands_beyond_the_strokes_are_warned_of_once():
    with running() as sim:
        sim.start()
        sim.set_joint_target(JointTarget(q=np.array([1.2]), names=("q1",)))
        messages = run(sim, 3.0)
        sim.set_joint_target(JointTarget(q=np.zeros(8)))
        back = run(sim, 3.0)
        sim.set_joint_target(JointTarget(q=np.array([1.2]), names=("q1",)))
        again = run(sim, 3.0)
    (text,) = events(messages)
    assert text.startswith("the joints ask for more than the pistons' strokes: a1_")
    assert text.endswith("must be within 0.19..0.25 m")
    assert {message.severity for message in messages if isinstance(message, Event)} == {Severity.WARNING}
    assert events(back) == []
    assert len(events(again)) == 1
    assert last(JointState, messages).q[0] == 1.2, "nobody is stopped"


def test_the_core_link_is_a_setting():
    with running(SimConfig(actuators=ActuatorConfig(core_link_m=0.205))) as sim:
        state = only(ActuatorState, sim.start())
    np.testing.assert_allclose(state.positions[:4], 0.2)


# ---- time, reset, seed


def test_a_pause_holds_everything_still_and_steps_go_on():
    with running() as sim:
        sim.start()
        sim.set_joint_target(JointTarget(q=np.full(1, 1.0), names=("q1",), duration_s=1.0))
        run(sim, 0.3)
        clock = only(Clock, sim.control(SimControl(action=SimAction.PAUSE)))
        assert (clock.stamp_ns, clock.real_time_factor) == (300_000_000, 0.0)
        assert run(sim, 1.0) == []
        sim.control(SimControl(action=SimAction.STEP, num_steps=10))
        stepped = run(sim, 1.0)
        assert last(JointState, stepped).stamp_ns == 400_000_000
        assert last(JointState, stepped).q[0] == pytest.approx(0.4)
        sim.control(SimControl(action=SimAction.RESUME))
        assert last(JointState, run(sim, 0.6)).q[0] == 1.0


def test_a_reset_goes_back_to_the_start_and_time_goes_on():
    with running() as sim:
        start = sim.start()
        sim.set_actuator_target(ActuatorTarget(positions=np.array([0.24, 0.21]), names=("a1_l", "a2_l")))
        run(sim, 1.0)
        messages = sim.control(SimControl(action=SimAction.RESET))
        later = run(sim, 1.0)
    assert only(JointState, messages).stamp_ns == 1_000_000_000
    for kind, field in ((JointState, "q"), (ActuatorState, "positions"), (LegState, "T_world_foot")):
        np.testing.assert_allclose(getattr(last(kind, later), field), getattr(only(kind, start), field), atol=1e-12)
    assert events(messages) == ["the robot is back at its initial place and posture"]


def test_a_seed_starts_the_noise_anew():
    config = SimConfig(encoders=EncoderConfig(bias_rad=0.01, noise_rad=0.01))
    with running(config, seed=7) as first, running(config, seed=8) as second:
        expected = last(JointState, first.start()).q
        assert not np.array_equal(last(JointState, second.start()).q, expected)
        second.control(SimControl(seed=7))
        np.testing.assert_array_equal(only(JointState, second.step()).q, expected)
        with pytest.raises(RefusedError, match="seed is -1, must not be negative"):
            second.control(SimControl(seed=-1))
