from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from services.player.trajectory import MoveTo, read_trajectory
from services.sim.climbing_sim import ClimbingSim
from services.sim.engine import Engine
from shared.errors import InputFileError, RefusedError
from shared.geometry import SE3
from shared.messaging.frames import FrameTree
from shared.messaging.messages import (
    JOINT_NAMES,
    ActuatorState,
    ActuatorTarget,
    Clock,
    FixedFootDescription,
    Foot,
    JointState,
    JointTarget,
    LegState,
    LegTarget,
    RobotDescription,
    Stop,
    StructureDescription,
    Transforms,
)
from shared.robot.adhesion import MagnetLimits, margin
from shared.robot.kinematics import T_fixed_free
from shared.robot.statics import RobotMasses
from shared.runtime.config import CONFIGS_DIR, SimConfig
from shared.world.urdf_format import structure_urdf
from tests.support.robots import MARK, MODEL, NOTHING, ORIGINAL, URDF, T_world_foot, events, last, only, run, running

LIMITS = [MODEL.limits[name] for name in JOINT_NAMES]
LINKS = (
    "foot_a",
    "leg_a_lower",
    "leg_a_upper",
    "platform_a",
    "hip",
    "lidar",
    "depth",
    "depth_optical",
    "platform_b",
    "leg_b_upper",
    "leg_b_lower",
)

postures = st.tuples(*(st.floats(limit.lower, limit.upper) for limit in LIMITS)).map(np.array)
feet = st.sampled_from(list(Foot))


def assert_still(T: SE3, other: SE3) -> None:
    np.testing.assert_allclose(T.matrix, other.matrix, rtol=0, atol=1e-9)


# ---- messages


def test_it_starts_with_descriptions_and_states_at_time_zero():
    with running(structure=ORIGINAL) as sim:
        messages = sim.start()
    kinds = {RobotDescription, FixedFootDescription, StructureDescription, JointState, Transforms, Clock, LegState}
    kinds |= {ActuatorState}
    assert {type(message) for message in messages} == kinds
    assert {(message.stamp_ns, message.seq) for message in messages} == {(0, 0)}
    assert only(RobotDescription, messages).urdf == URDF
    assert only(RobotDescription, messages).frame == only(JointState, messages).frame == "foot_a"
    assert only(StructureDescription, messages).urdf == structure_urdf(ORIGINAL)
    leg = only(LegState, messages)
    assert (leg.fixed_foot, leg.frame, leg.has_contact) == (Foot.A, "world", True)
    expected = SE3.from_rpy((0, 0, np.pi / 2), (0, -0.775, 10.105))
    assert_still(SE3.from_xyz_quat_xyzw(leg.T_world_foot), expected)


@pytest.mark.parametrize("foot", Foot)
def test_either_foot_may_be_fixed_first(foot):
    with running(SimConfig(initial_foot=foot, initial_foot_xyz_m=(1, 2, 3), initial_foot_rpy_deg=(90, 0, 0))) as sim:
        messages = sim.start()
    expected = SE3.from_rpy((np.pi / 2, 0, 0), (1, 2, 3))
    assert_still(SE3.from_xyz_quat_xyzw(only(LegState, messages).T_world_foot), expected)
    assert_still(T_world_foot(only(Transforms, messages), foot), expected)
    assert_still(FrameTree(only(Transforms, messages)).T_root("fixed_foot"), expected)


def test_transforms_reach_every_link_from_the_world():
    with running() as sim:
        transforms = only(Transforms, sim.start())
    assert transforms.frame == transforms.parents[0] == "world"
    assert set(transforms.children) == {*LINKS, "foot_b", "fixed_foot"}
    tree = FrameTree(transforms)
    np.testing.assert_allclose(tree.T_root("foot_b").translation, [0, -0.625, 10.13], atol=1e-12)
    np.testing.assert_allclose(tree.T_root("lidar").translation, [0, -0.7, 10.4615], atol=1e-12)


def test_time_and_sequence_numbers_count_up_without_drift():
    with running(SimConfig(rate_hz=30)) as sim:
        sim.start()
        clocks = [only(Clock, sim.step()) for _ in range(60)]
    assert [clock.seq for clock in clocks] == list(range(1, 61))
    assert clocks[0].stamp_ns == 33_333_333
    assert clocks[29].stamp_ns == 1_000_000_000
    assert clocks[59].stamp_ns == 2_000_000_000


def test_leg_state_comes_at_its_rate_and_on_change():
    with running() as sim:
        sim.start()
        steps = [any(type(message) is LegState for message in sim.step()) for _ in range(100)]
        assert [i + 1 for i, has_leg_state in enumerate(steps) if has_leg_state] == list(range(10, 101, 10))
        (change,) = sim.set_fixed_foot(LegTarget(foot=Foot.B))
    assert (change.fixed_foot, change.seq, change.stamp_ns) == (Foot.B, 11, 1_000_000_000)


def test_a_foot_in_the_air_has_no_contact():
    with running(SimConfig(initial_foot_xyz_m=(0.0, -0.775, 10.1117)), ORIGINAL) as sim:
        assert only(LegState, sim.start()).has_contact is False


# ---- motion


def test_joints_move_together_at_the_slowest_ones_limit_and_stop():
    with running() as sim:
        assert sim.set_joint_target(JointTarget(q=np.array([0.5, 0, 0, 0, 0, 0, 0.01, -1.0]))) == []
        halfway = only(JointState, [sim.step() for _ in range(50)][-1])
        end = only(JointState, [sim.step() for _ in range(50)][-1])
    np.testing.assert_allclose(halfway.q, [0.25, 0, 0, 0, 0, 0, 0.005, -0.5], atol=1e-12)
    np.testing.assert_allclose(halfway.dq, [0.5, 0, 0, 0, 0, 0, 0.01, -1.0], atol=1e-12)
    np.testing.assert_array_equal(end.q, [0.5, 0, 0, 0, 0, 0, 0.01, -1.0])
    np.testing.assert_array_equal(end.dq, np.zeros(8))


def test_joints_that_are_not_named_keep_their_target():
    with running(SimConfig(rate_hz=10)) as sim:
        sim.set_joint_target(JointTarget(q=np.array([0.3]), names=("q4",)))
        sim.step()
        sim.set_joint_target(JointTarget(q=np.array([0.01, -0.2]), names=("q7", "q1"), duration_s=2.0))
        states = [only(JointState, sim.step()) for _ in range(20)]
    assert states[-2].dq.any()
    assert not states[-1].dq.any()
    np.testing.assert_array_equal(states[-1].q, [-0.2, 0, 0, 0.3, 0, 0, 0.01, 0])


@settings(max_examples=25)
@given(postures, postures, feet, st.integers(1, 40))
def test_no_link_moves_at_a_change_and_the_held_foot_never(first, second, foot, num_steps):
    with running(SimConfig(rate_hz=10, initial_foot=foot)) as sim:
        held = SE3.from_xyz_quat_xyzw(only(LegState, sim.start()).T_world_foot)
        sim.set_joint_target(JointTarget(q=first))
        for _ in range(num_steps):  # often still moving at the change
            before = only(Transforms, sim.step())
            assert_still(T_world_foot(before, foot), held)
        (change,) = sim.set_fixed_foot(LegTarget(foot=foot.other))
        held = SE3.from_xyz_quat_xyzw(change.T_world_foot)
        assert_still(T_world_foot(before, foot.other), held)
        sim.set_joint_target(JointTarget(q=second))
        for _ in range(10):
            assert_still(T_world_foot(only(Transforms, sim.step()), foot.other), held)


@settings(max_examples=25)
@given(postures, feet)
def test_at_rest_a_change_moves_nothing(q, foot):
    with running(SimConfig(rate_hz=10, initial_foot=foot)) as sim:
        sim.set_joint_target(JointTarget(q=q))
        before = [sim.step() for _ in range(40)][-1]
        sim.set_fixed_foot(LegTarget(foot=foot.other))
        after = sim.step()
    np.testing.assert_array_equal(only(JointState, before).q, only(JointState, after).q)
    trees = [FrameTree(only(Transforms, messages)) for messages in (before, after)]
    for link in (*LINKS, "foot_b"):
        assert_still(trees[0].T_root(link), trees[1].T_root(link))


def test_the_engine_places_any_link_exactly():
    offset_root = URDF.replace(
        '<link name="foot_a">\n    <inertial>',
        '<link name="foot_a">\n    <inertial>\n      <origin xyz="0.1 0.2 0.3" rpy="1 2 3"/>',
    )
    assert offset_root != URDF
    T_world_link = SE3.from_rpy((0.4, 0.5, 0.6), (100.0, -200.0, 50.0))
    rng = np.random.default_rng(2)
    for urdf in (URDF, offset_root):
        world = Engine(urdf, JOINT_NAMES)
        for link in world.links:
            world.place(rng.uniform(-1, 1, 8), np.zeros(8), link, T_world_link)
            assert_still(world.T_world(link), T_world_link)
        world.close()


# ---- refusals


@pytest.mark.parametrize(
    ("target", "reason"),
    [
        ({"q": np.zeros(7)}, "q has 7 values, 8 expected (q1, q2, q3, q4, q5, q6, q7, q8)"),
        ({"q": np.zeros(0), "names": ()}, "q has 0 values, at least 1 expected ()"),
        ({"q": np.zeros(2), "names": ("q1",)}, "q has 2 values, 1 expected (q1)"),
        (
            {"q": np.zeros(2), "names": ("q1", "q9")},
            "unknown joint 'q9'; joints are q1, q2, q3, q4, q5, q6, q7, q8",
        ),
        ({"q": np.zeros(2), "names": ("q1", "q1")}, "joint 'q1' is named 2 times"),
        (
            {"q": np.array([0, 0.026, 0, -3.3, 0, 0, 0, 0])},
            "q2 is 0.026 m, must be within -0.025..0.025 m; q4 is -3.3 rad, must be within -3.2..3.2 rad",
        ),
        ({"q": np.zeros(8), "duration_s": 0.0}, "duration_s is 0, must be above 0 and at most 86400"),
        ({"q": np.zeros(8), "duration_s": -2.0}, "duration_s is -2, must be above 0 and at most 86400"),
        ({"q": np.zeros(8), "duration_s": 1e300}, "duration_s is 1e+300, must be above 0 and at most 86400"),
    ],
)
def test_a_refused_target_says_why_and_changes_nothing(target, reason):
    with running(SimConfig(rate_hz=10)) as sim:
        sim.set_joint_target(JointTarget(q=np.full(1, 0.2), names=("q1",)))
        with pytest.raises(RefusedError) as caught:
            sim.set_joint_target(JointTarget(**target))
        assert str(caught.value) == reason
        states = [only(JointState, sim.step()) for _ in range(2)]
    np.testing.assert_array_equal(states[-1].q, [0.2, 0, 0, 0, 0, 0, 0, 0])


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ('name="q3"', 'name="knee"', "joints q3 are missing; it has q1, q2, knee"),
        ('type="fixed"', 'type="continuous"', "joint 'lidar_mount': <limit> is missing"),
        ('"foot_b"', '"hand"', "links foot_b are missing"),
        (
            '<joint name="lidar_mount" type="fixed">',
            '<joint name="lidar_mount" type="continuous"><limit velocity="1"/>',
            "unknown joints lidar_mount; only q1",
        ),
        ('"hip"', '"pelvis"', "link 'pelvis' has a mass and is fixed to none of foot_a, leg_a_lower"),
        ("<robot ", "<robots ", "robot URDF: not valid XML: mismatched tag"),
    ],
)
def test_another_robot_is_refused(old, new, reason):
    assert old in URDF
    with pytest.raises(InputFileError) as caught:
        ClimbingSim(SimConfig(), URDF.replace(old, new), NOTHING, MARK)
    assert reason in str(caught.value)


# ---- the climb that is shipped


def landings() -> Iterator[tuple[Foot, np.ndarray, np.ndarray, SE3]]:
    """Each landing: the fixed foot, joints before and after its last move, and T_world_foot of the fixed foot."""
    fixed, q = SimConfig().initial_foot, np.zeros(8)
    T_world_fixed = SE3.from_rpy(np.deg2rad(SimConfig().initial_foot_rpy_deg), SimConfig().initial_foot_xyz_m)
    rows = read_trajectory(CONFIGS_DIR / "trajectories" / "climb.csv")
    for row, next_row in zip(rows, (*rows[1:], None), strict=True):
        if isinstance(row, MoveTo):
            if not isinstance(next_row, MoveTo):
                yield fixed, q, row.q, T_world_fixed
            q = row.q
        else:
            T_world_fixed = T_world_fixed @ T_fixed_free(q, fixed)
            fixed = fixed.other


def gap_and_angle(T_world_foot: SE3) -> tuple[float, float]:
    """Metres from the sole's farthest corner to the steel face below it, and radians to the face's normal."""
    best = (np.inf, np.inf)
    corners = np.array([[x, y, -0.005] for x in (-0.05, 0.05) for y in (-0.05, 0.05)])
    for bar in ORIGINAL.members:
        T_bar_foot = bar.T_world_member.inv() @ T_world_foot
        axis = int(np.argmax(np.abs(T_bar_foot.rotation[:, 2])))
        side = np.sign(T_bar_foot.rotation[axis, 2])
        half = np.array(bar.solid.size_m) / 2
        corners_bar = T_bar_foot.apply(corners)
        across = [i for i in range(3) if i != axis]
        if (np.abs(corners_bar[:, across]) <= half[across]).all():
            gap_m = float(np.abs(side * corners_bar[:, axis] - half[axis]).max())
            best = min(best, (gap_m, float(np.arccos(min(1.0, abs(T_bar_foot.rotation[axis, 2]))))))
    return best


def test_each_step_of_the_climb_lands_flush_on_steel():
    moves = list(landings())
    assert [fixed.value for fixed, *_ in moves] == list("ABABABABA")
    for fixed, _, q, T_world_fixed in moves:
        gap_m, angle_rad = gap_and_angle(T_world_fixed @ T_fixed_free(q, fixed))
        assert gap_m < 1e-4
        assert angle_rad < np.deg2rad(0.01)


def test_the_climb_goes_from_beam_over_a_post_to_a_beam():
    fixed, _, q, T_world_fixed = list(landings())[-1]
    assert (T_world_fixed @ T_fixed_free(q, fixed)).translation[0] > 0.6
    normals = [(T @ T_fixed_free(q, fixed)).rotation[:, 2].round(3).tolist() for fixed, _, q, T in landings()]
    up, south, east = [0, 0, 1], [0, -1, 0], [1, 0, 0]
    assert normals == [up, south, south, east, east, up, up, up, up]


def test_the_fixed_foot_says_what_it_would_bear():
    with running(SimConfig(initial_foot_rpy_deg=(90, 0, 0))) as sim:
        state = only(LegState, sim.start())
    weight_n = RobotMasses.from_urdf(MODEL).total_kg * 9.81
    np.testing.assert_allclose(state.wrench[:3], [0, weight_n, 0], atol=1e-9)
    assert state.holding == (Foot.A,)
    assert state.load_n == pytest.approx(0.0, abs=1e-9)
    assert state.margin == pytest.approx(float(margin(state.wrench, MagnetLimits())))
    assert 0.0 < state.margin < 0.5


# ---- stops

FAR = np.array([0.5, 0, 0, 0, 0, 0, 0.01, -1.0])


def test_a_stop_halts_every_joint_where_it_is():
    with running() as sim:
        sim.set_joint_target(JointTarget(q=FAR))
        before = last(JointState, run(sim, 0.3))
        (event,) = events(sim.stop(Stop(text="someone is near")))
        after = [message for message in run(sim, 1.0) if isinstance(message, JointState)]
    assert before.dq.any()
    assert event == "the robot is stopped: someone is near"
    for state in after:
        np.testing.assert_allclose(state.q, before.q, rtol=0, atol=1e-12)
        np.testing.assert_array_equal(state.dq, np.zeros(8))


def test_targets_that_were_under_way_when_the_robot_was_stopped_are_refused():
    with running() as sim:
        sim.stop(Stop())
        run(sim, 0.19)
        with pytest.raises(RefusedError, match=r"stopped less than 0.2 s ago"):
            sim.set_joint_target(JointTarget(q=FAR))
        with pytest.raises(RefusedError, match=r"stopped less than 0.2 s ago"):
            sim.set_actuator_target(ActuatorTarget(positions=np.array([0.1]), names=("th_a",)))
        run(sim, 0.01)
        sim.set_joint_target(JointTarget(q=FAR))
        np.testing.assert_array_equal(last(JointState, run(sim, 1.0)).q, FAR)


def test_core_links_halt_too():
    with running() as sim:
        sim.set_actuator_target(ActuatorTarget(positions=np.array([0.24, 0.24]), names=("a1_l", "a1_r")))
        before = last(ActuatorState, run(sim, 0.1)).positions
        sim.stop(Stop())
        after = last(ActuatorState, run(sim, 1.0))
    np.testing.assert_allclose(after.positions, before, atol=1e-9)
    np.testing.assert_allclose(after.velocities, 0, atol=1e-9)


def test_a_target_that_is_not_renewed_halts_the_robot_and_says_so_once():
    with running() as sim:
        sim.set_joint_target(JointTarget(q=FAR, valid_s=0.25))
        messages = run(sim, 1.5)
    states = [message for message in messages if isinstance(message, JointState)]
    assert events(messages) == ["the joint target was not renewed in time: the robot is stopped"]
    np.testing.assert_allclose(states[-1].q, 0.25 * FAR, atol=1e-12)
    assert not any(state.dq.any() for state in states[25:])


def test_a_target_that_is_renewed_goes_on_undisturbed():
    target = JointTarget(q=FAR, duration_s=2.0, valid_s=0.25)
    with running() as sim:
        positions = []
        for _ in range(12):
            sim.set_joint_target(target)
            positions += [message.q for message in run(sim, 0.2) if isinstance(message, JointState)]
        messages = run(sim, 1.0)
    np.testing.assert_allclose(positions[149], 0.75 * FAR, atol=1e-12)
    np.testing.assert_array_equal(positions[-1], FAR)
    assert events(messages) == [], "it had arrived: nothing had to be stopped"


def test_another_target_ends_the_watch_over_the_first():
    with running() as sim:
        sim.set_joint_target(JointTarget(q=FAR, valid_s=0.25))
        sim.set_joint_target(JointTarget(q=0.5 * FAR))
        messages = run(sim, 1.5)
    np.testing.assert_array_equal(last(JointState, messages).q, 0.5 * FAR)
    assert events(messages) == []
