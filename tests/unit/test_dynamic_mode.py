import numpy as np
import pytest

from shared.geometry import SE3
from shared.messaging.messages import (
    Event,
    Foot,
    JointState,
    JointTarget,
    LegState,
    LegTarget,
    Severity,
    SimAction,
    SimControl,
    Stop,
    Transforms,
)
from shared.robot.statics import RobotMasses, holding_wrench
from shared.runtime.config import MagnetConfig, SimConfig
from shared.solids import Box
from shared.world.structure import Member, Structure
from tests.support.robots import MODEL, ORIGINAL, T_world_foot, events, last, only, run, running

DYNAMIC = SimConfig(mode="dynamic")
MASSES = RobotMasses.from_urdf(MODEL)
ARM = np.array([0.5, 0.01, 0.2, 0.4, 0.6, 0.5, -0.02, 0.3])
"""The robot leans over, its free leg in the air."""


def pad(rpy_deg=(0.0, 0.0, 0.0)) -> tuple[Structure, SimConfig]:
    """A block just large enough for one foot, foot A flush on its top, both turned about the origin."""
    T = SE3.from_rpy(np.deg2rad(rpy_deg))
    foot = T @ SE3.trans(z_m=0.005)
    structure = Structure("pad", (Member("block", Box((0.12, 0.12, 0.2)), T @ SE3.trans(z_m=-0.1)),), None)
    place = {"initial_foot_xyz_m": tuple(foot.translation), "initial_foot_rpy_deg": rpy_deg}
    return structure, SimConfig(mode="dynamic", **place)


def test_a_still_robot_bears_its_weight():
    structure, config = pad()
    with running(config, structure) as sim:
        assert only(LegState, sim.start()).holding == (Foot.A,)
        state = last(LegState, run(sim, 1.0))
    assert MASSES.total_kg == pytest.approx(4.647)
    np.testing.assert_allclose(state.wrench[:3], [0, 0, 4.647 * 9.81], atol=0.05)
    assert state.load_n == 0.0
    assert 0.8 < state.margin < 1.0


@pytest.mark.parametrize("rpy_deg", [(0, 0, 0), (90, 0, 0), (180, 0, 30), (35, -50, 70)])
def test_the_wrench_of_a_still_robot_is_that_of_statics(rpy_deg):
    structure, config = pad(rpy_deg)
    with running(config, structure) as sim:
        sim.start()
        sim.set_joint_target(JointTarget(q=ARM, duration_s=4.0))
        messages = run(sim, 6.0)
    state, joints, transforms = (last(kind, messages) for kind in (LegState, JointState, Transforms))
    assert events(messages) == []
    R_world_foot = T_world_foot(transforms, Foot.A).rotation
    expected = holding_wrench(joints.q, Foot.A, R_world_foot, MASSES)
    assert np.linalg.norm(state.wrench[:3] - expected[:3]) < 0.02 * np.linalg.norm(expected[:3])
    assert np.linalg.norm(state.wrench[3:] - expected[3:]) < 0.02 * np.linalg.norm(expected[3:])
    assert np.abs(joints.q - ARM).max() < 2e-4
    assert state.load_n == pytest.approx(max(0.0, -expected[2]), rel=0.02)


def test_joints_keep_their_velocity_and_effort_limits():
    structure, config = pad()
    with running(config, structure) as sim:
        sim.start()
        sim.set_joint_target(JointTarget(q=0.8 * ARM))
        states = [message for message in run(sim, 4.0) if isinstance(message, JointState)]
    velocity = np.array([MODEL.limits[f"q{i}"].velocity for i in range(1, 9)])
    effort = np.array([MODEL.limits[f"q{i}"].effort for i in range(1, 9)])
    assert (np.abs([state.dq for state in states]) < 1.02 * velocity).all()
    assert (np.abs([state.effort for state in states]) <= effort + 1e-6).all()
    assert np.abs([state.effort for state in states]).max() > 1.0
    assert np.abs(states[-1].q - 0.8 * ARM).max() < 2e-4


def test_both_feet_hold_during_a_change_and_nothing_moves():
    with running(DYNAMIC, ORIGINAL) as sim:
        before = {foot: T_world_foot(only(Transforms, sim.start()), foot) for foot in Foot}
        run(sim, 0.3)
        change = only(LegState, sim.set_fixed_foot(LegTarget(foot=Foot.B)))
        assert (change.fixed_foot, change.holding) == (Foot.A, (Foot.A, Foot.B))
        during = last(LegState, run(sim, 0.15))
        assert during.holding == (Foot.A, Foot.B)
        messages = run(sim, 1.0)
    after = last(LegState, messages)
    assert (after.fixed_foot, after.holding, after.has_contact) == (Foot.B, (Foot.B,), True)
    assert [message for message in messages if isinstance(message, Event)] == []
    for foot in Foot:
        moved = before[foot].inv() @ T_world_foot(last(Transforms, messages), foot)
        assert np.linalg.norm(moved.translation) < 1e-4
    assert after.wrench[2] > 0.8 * 4.647 * 9.81, "a little of the weight still rests on the foot that was released"


def test_a_foot_that_finds_no_steel_leaves_the_robot_to_fall():
    structure, config = pad((180, 0, 0))
    with running(config, structure) as sim:
        sim.start()
        sim.set_joint_target(JointTarget(q=np.array([0.3]), names=("q1",), duration_s=1.0))
        run(sim, 1.5)
        news = sim.set_fixed_foot(LegTarget(foot=Foot.B))
        texts = [message.text for message in news if isinstance(message, Event)]
        assert texts[0].startswith("foot B does not hold: there is no steel below it; it takes hold within 2 mm")
        assert texts[1] == "foot A is released; nothing holds the robot, it falls"
        assert {message.severity for message in news if isinstance(message, Event)} == {Severity.ERROR}
        messages = run(sim, 1.0)
    state = last(LegState, messages)
    assert (state.fixed_foot, state.holding, state.wrench, state.margin) == (Foot.B, (), None, None)
    start_m = only(LegState, news).T_world_foot[2]
    assert state.T_world_foot[2] == pytest.approx(start_m - 9.81 / 2, abs=0.3)


def test_a_robot_that_fell_lies_on_the_ground():
    structure, config = pad((180, 0, 0))
    with running(config, Structure("hanging", structure.members, ground_z_m=-2.0)) as sim:
        sim.start()
        sim.set_joint_target(JointTarget(q=np.array([0.3]), names=("q1",), duration_s=1.0))
        run(sim, 1.5)
        sim.set_fixed_foot(LegTarget(foot=Foot.B))
        transforms = last(Transforms, run(sim, 3.0))
    heights_m = [T_world_foot(transforms, foot).translation[2] for foot in Foot]
    assert -2.001 < min(heights_m) < -1.9
    assert max(heights_m) < -1.4


def test_an_overload_is_named_and_the_robot_falls():
    weak = DYNAMIC.model_copy(update={"magnets": MagnetConfig(pull_n=100.0)})
    structure, config = pad((90, 0, 0))
    with running(config.model_copy(update={"magnets": weak.magnets}), structure) as sim:
        sim.start()
        messages = run(sim, 1.0)
    (text,) = events(messages)
    assert text.startswith("foot A lets go: ")
    assert "must be at most" in text
    assert text.endswith("; nothing holds the robot, it falls")
    assert last(LegState, messages).T_world_foot[2] < -1.0
    assert last(LegState, messages).holding == ()


def test_a_foot_hung_in_the_air_never_held():
    in_the_air = DYNAMIC.model_copy(update={"initial_foot_xyz_m": (0.0, -0.775, 10.1117)})
    with running(in_the_air, ORIGINAL) as sim:
        assert only(LegState, sim.start()).holding == ()
        (text,) = events(run(sim, 0.05))
    assert text.startswith("foot A does not hold: 100% of its sole are over steel, 6.7 mm and 0.0 deg off")


def test_a_magnet_draws_its_foot_flush():
    near = DYNAMIC.model_copy(update={"initial_foot_xyz_m": (0.0, -0.775, 10.106), "initial_foot_rpy_deg": (1, 0, 90)})
    with running(near, ORIGINAL) as sim:
        sim.start()
        state = last(LegState, run(sim, 1.0))
    T = SE3.from_xyz_quat_xyzw(state.T_world_foot)
    assert T.translation[2] == pytest.approx(10.105, abs=2e-5)
    assert T.rotation[2, 2] == pytest.approx(1.0, abs=1e-6)


def test_after_a_fall_a_reset_puts_it_back():
    with running(DYNAMIC, ORIGINAL) as sim:
        sim.start()
        sim.set_joint_target(JointTarget(q=np.array([0.3]), names=("q1",), duration_s=1.0))
        run(sim, 1.5)
        sim.set_fixed_foot(LegTarget(foot=Foot.B))
        run(sim, 1.0)
        messages = sim.control(SimControl(action=SimAction.RESET))
        assert only(LegState, messages).holding == (Foot.A,)
        after = run(sim, 0.5)
    assert events(after) == []
    assert last(JointState, after).stamp_ns == 3_000_000_000
    np.testing.assert_allclose(last(JointState, after).q, np.zeros(8), atol=1e-4)
    np.testing.assert_allclose(last(LegState, after).T_world_foot[:3], [0, -0.775, 10.105], atol=1e-5)


@pytest.mark.parametrize("rate_hz", [30.0, 100.0, 1000.0])
def test_physics_goes_by_simulated_time_at_any_rate(rate_hz):
    with running(SimConfig(mode="dynamic", rate_hz=rate_hz, initial_foot_xyz_m=(0, 0, 100))) as sim:
        sim.start()
        for _ in range(round(rate_hz)):
            messages = sim.step()
    transforms = only(Transforms, messages)
    assert transforms.stamp_ns == 1_000_000_000
    assert T_world_foot(transforms, Foot.A).translation[2] == pytest.approx(100 - 9.81 / 2, abs=0.02)


def test_a_stop_brakes_as_hard_as_the_drives_may_and_stays_there():
    structure, config = pad()
    with running(config, structure) as sim:
        sim.start()
        sim.set_joint_target(JointTarget(q=np.array([0.6]), names=("q4",)))
        before = last(JointState, run(sim, 0.4))
        sim.stop(Stop(text="now"))
        braking = last(JointState, run(sim, 0.3))
        after = last(JointState, run(sim, 1.0))
    assert before.dq[3] > 0.9
    way = before.dq[3] ** 2 * config.dynamics.ramp_s / 2
    assert braking.q[3] - before.q[3] == pytest.approx(way, abs=0.02)
    np.testing.assert_allclose(after.dq, 0, atol=1e-3)
    assert abs(after.q[3] - braking.q[3]) < 0.005
