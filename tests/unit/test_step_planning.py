import numpy as np
import pytest

from services.planner.footing import footings, is_flush
from services.planner.goal_postures import goal_postures
from services.planner.step_space import StepSpace
from shared.climbing.climber import Climber
from shared.climbing.stance import Stance
from shared.errors import RefusedError
from shared.geometry import SE3
from shared.messaging.messages import Foot, FootTarget
from shared.robot.adhesion import MagnetLimits
from shared.runtime.config import PlannerConfig
from shared.solids import Box
from shared.world.generator import Lattice, crossed_truss
from shared.world.structure import Member, Structure
from tests.support.postures import MODEL
from tests.support.steel import BEAM, ORIGINAL, structure
from tests.support.stepping import START, ZERO, at, planned, walk

A, B = Foot.A, Foot.B
UP, DOWN, SOUTH, EAST = (0, 0, 1), (0, 0, -1), (0, -1, 0), (1, 0, 0)
CLIMBER = Climber.of(MODEL, ORIGINAL)
ON_BEAM = Stance(A, SE3.trans(z_m=0.005))


def path_of(plan):
    return np.concatenate([plan.lift, plan.transfer, plan.landing])


@pytest.mark.parametrize(
    "steps",
    [
        pytest.param([(B, at((0, -0.35, 10.1), UP)), (A, at((0, -0.55, 10.1), UP))], id="along a bar, each foot"),
        pytest.param([(B, at((0, -0.35, 10.1), UP)), (A, at((0, -0.1, 10.3), SOUTH))], id="bar to post, concave"),
    ],
)
def test_steps_on_the_original_structure_pass_the_check(steps):
    plans, reports = walk(CLIMBER, START, steps)
    assert [problem for report in reports for problem in report.problems] == []
    landings = [report.landing for report in reports if report.kind == "move" and report.landing]
    assert len(landings) == len(steps) == len(plans)
    assert all(abs(landing.gap_m) < 1e-6 and landing.angle_rad < 1e-6 for landing in landings)
    assert all(plan.margin > 0 for plan in plans)


def test_round_the_post_from_one_face_to_the_next():
    on_post = Stance(A, SE3.from_z_axis(SOUTH, (0, -0.105, 10.3)))
    q = planned(at((0, -0.1, 10.5), SOUTH), on_post, ZERO, CLIMBER).landing[-1]
    beside = SE3.from_z_axis(SOUTH, (0.05, -0.105, 10.55)) @ SE3.rot("z", np.pi / 2)
    steps = [(B, FootTarget(T_world_foot=beside.xyz_quat_xyzw)), (A, at((0.1, -0.03, 10.5), EAST))]
    plans, reports = walk(CLIMBER, on_post, steps, q=q)
    assert [problem for report in reports for problem in report.problems] == []
    assert plans[-1].T_world_goal.rotation[:, 2] == pytest.approx(EAST, abs=1e-8)


def test_from_the_post_to_the_bar_above():
    hanging = Stance(B, SE3.from_z_axis(SOUTH, (0, -0.105, 11.5)))
    q = planned(at((0, -0.1, 11.2), SOUTH), hanging, ZERO, CLIMBER).landing[-1]
    _, reports = walk(CLIMBER, hanging, [(A, at((0, -0.35, 11.8), DOWN))], q=q)
    assert [problem for report in reports for problem in report.problems] == []
    assert reports[-1].landing.members == ("beam_y_5",)


def test_the_foot_leaves_and_lands_along_its_normal():
    plan = planned(at((0, -0.1, 10.3), SOUTH), *_stance_at_the_post(), CLIMBER)
    for phase, is_lift in ((plan.lift, True), (plan.landing, False)):
        poses = [plan.stance.T_world_free(q) for q in phase]
        ground = poses[0] if is_lift else poses[-1]
        moves = [(ground.inv() @ pose).log() for pose in poses]
        heights = [move[2] for move in moves]
        assert heights == sorted(heights, reverse=not is_lift)
        assert max(heights) == pytest.approx(0.03, abs=1e-9)
        assert np.abs(np.delete(moves, 2, axis=1)).max() < 1e-8
    assert (plan.lift[-1] == plan.transfer[0]).all()
    assert (plan.transfer[-1] == plan.landing[0]).all()


def _stance_at_the_post():
    plan = planned(at((0, -0.35, 10.1), UP), START, ZERO, CLIMBER)
    q = plan.landing[-1]
    return START.changed(q), q


def test_the_same_seed_gives_the_same_plan_and_a_pose_is_met_exactly():
    stance, q = _stance_at_the_post()
    target = at((0.03, -0.1, 10.3), SOUTH)
    first, again = (planned(target, stance, q, CLIMBER, seed=5) for _ in range(2))
    np.testing.assert_array_equal(path_of(first), path_of(again))
    pose = first.T_world_goal
    to_pose = planned(FootTarget(T_world_foot=pose.xyz_quat_xyzw), stance, q, CLIMBER)
    assert (pose.inv() @ to_pose.T_world_goal).matrix == pytest.approx(np.eye(4), abs=1e-8)
    assert pose.translation == pytest.approx([0.03, -0.105, 10.3], abs=1e-9)


def test_a_target_a_little_off_is_set_flush():
    off = SE3.from_rpy((0.02, 0.01, np.pi / 2), (0, -0.35, 10.108))
    plan = planned(FootTarget(T_world_foot=off.xyz_quat_xyzw), START, ZERO, CLIMBER)
    assert is_flush(plan.T_world_goal, CLIMBER.steel)


def crossed(T_world: SE3) -> Structure:
    """Two bars that cross at 60 degrees, one lying on the other, and a third that leans on both; all turned."""
    bars = {
        "low": SE3.trans(z_m=-0.075),
        "high": SE3.trans(0.45, 0, 0.075) @ SE3.rot("z", np.deg2rad(60)),
        "lean": SE3.trans(-0.35, 0.4, 0.3) @ SE3.rot("x", np.deg2rad(35)) @ SE3.rot("z", 0.3),
    }
    return Structure("crossed", tuple(Member(n, Box((2.0, 0.15, 0.15)), T_world @ T) for n, T in bars.items()), None)


def test_steps_on_crossed_bars_turned_by_odd_angles():
    T = SE3.from_rpy((0.23, -0.31, 1.17), (3.1, -2.7, 8.3))
    climber = Climber.of(MODEL, crossed(T))
    start = Stance(A, T @ SE3.trans(-0.2, z_m=0.005))
    low = (B, at(T.apply(np.array([0.12, 0.0, 0.0])), T.rotation[:, 2]))
    high = (A, at(T.apply(np.array([0.45, 0.0, 0.15])), T.rotation[:, 2]))
    _, reports = walk(climber, start, [low, high])
    assert [problem for report in reports for problem in report.problems] == []
    assert reports[-1].landing.members == ("high",)


def test_steps_on_a_generated_crossed_truss_turned_by_an_odd_angle():
    truss = crossed_truss(Lattice(yaw_deg=23.7, base_z_m=3.0))
    T = SE3.rot("z", np.deg2rad(23.7))
    start = Stance(A, T @ SE3.trans(0.775, z_m=5.155) @ SE3.rot("z", np.pi))
    on_beam = (B, at(T.apply(np.array([0.325, 0.0, 5.15])), UP))
    on_post = [
        (foot, at(T.apply(np.array([0.075, 0.0, z_m])), T.rotation[:, 0])) for foot, z_m in ((A, 5.35), (B, 5.6))
    ]
    _, reports = walk(Climber.of(MODEL, truss), start, [on_beam, *on_post])
    assert [problem for report in reports for problem in report.problems] == []
    landings = [report.landing.members for report in reports[1:] if report.landing]
    assert landings == [("beam_x_1_1_1",), ("post_1_1_1",), ("post_1_1_1",)]


def test_a_fixed_foot_that_stands_askew_still_finds_its_way_along_the_bar():
    askew = Stance(A, START.T_world_foot @ SE3.rot("x", np.deg2rad(0.2)))
    ahead = SE3.from_rpy((0, 0, np.pi / 2), (0, -0.4, 10.105))
    plan = planned(FootTarget(T_world_foot=ahead.xyz_quat_xyzw), askew, ZERO, CLIMBER)
    contact = CLIMBER.steel.under_sole(plan.T_world_goal)
    assert contact.is_flush(0.5e-3, np.deg2rad(0.5))


@pytest.mark.parametrize(
    ("target", "reason"),
    [
        (at((0, 0.5, 10.1), UP), "unreachable: the free foot would be 1.275 m from the fixed one, 0.585 m farther"),
        (at((0, -0.775, 9.9), DOWN), "unreachable: q"),
        (at((1, -0.4, 10.1), UP), "no flush steel there: the nearest steel is 300 mm from the sole"),
        (at((0.09, -0.4, 10.1), UP), "no flush steel there: beam_y_2 covers 60 % of the sole, 0.0 mm below it"),
        (
            at((0, -0.4, 10.11), UP),
            "no flush steel there: beam_y_2 covers 100 % of the sole, 10.0 mm below it, 0.0 deg",
        ),
        (at((0, -0.4, 10.1), (0, 0.1, 1)), "5.7 deg off; all of it within 0.5 mm and 0.5 deg is needed"),
    ],
)
def test_what_cannot_be_is_refused_with_the_reason(target, reason):
    with pytest.raises(RefusedError) as caught:
        planned(target, START, ZERO, CLIMBER)
    assert reason in str(caught.value)


def test_a_goal_inside_something_is_refused_as_collision_with_link_member_and_depth():
    lid = Member("lid", Box((0.3, 0.3, 0.1)), SE3.trans(0.4, z_m=0.09))
    with pytest.raises(
        RefusedError, match=r"^collision: \w+ would be [\d.]+ mm inside lid \(the best of \d+ postures\)$"
    ):
        planned(at((0.4, 0, 0), UP), ON_BEAM, ZERO, Climber.of(MODEL, structure(BEAM, lid)))


def test_no_way_to_a_free_goal_is_refused_as_collision():
    """A thread across the way that is too high to step over: both ends are free, and nothing between them."""
    net = [Member(f"thread_{i}", Box((0.002, 2.0, 0.002)), SE3.trans(0.27, z_m=0.02 * i)) for i in range(1, 11)]
    climber = Climber.of(MODEL, structure(BEAM, *net))
    with pytest.raises(RefusedError, match=r"^collision: no free way found after 25 iterations; on the straight one "):
        planned(at((0.4, 0, 0), UP), ON_BEAM, ZERO, climber, PlannerConfig(max_iterations=25))


def test_a_foot_under_a_shelf_cannot_lift_off():
    shelf = Member("shelf", Box((0.02, 0.3, 0.02)), SE3.trans(0.19, z_m=0.0215))
    with pytest.raises(
        RefusedError, match=r"^collision: foot B cannot lift off along its normal: foot_b cuts .* shelf"
    ):
        planned(at((0.4, 0, 0), UP), ON_BEAM, ZERO, Climber.of(MODEL, structure(BEAM, shelf)))


def test_no_landing_is_chosen_that_lets_go_once_it_is_the_fixed_foot_if_there_is_another():
    beside = SE3.from_z_axis(SOUTH, (0.05, -0.105, 10.55)) @ SE3.rot("z", np.pi / 2)
    space = StepSpace(CLIMBER, Stance(B, beside), min_margin=0.0)
    poses = footings(at((0.1, -0.03, 10.5), EAST), beside, CLIMBER.steel)
    q = goal_postures(space, poses, ZERO)
    assert len(q) > 1
    assert (CLIMBER.holding.margins_after(space.stance, q) >= 0).all()


def test_a_posture_in_which_the_fixed_foot_lets_go_is_not_free():
    wall = Stance(A, SE3.from_z_axis(SOUTH, (0, -0.105, 10.6)))
    stretched = np.array([[0, 0.02, 0, 0, 0, 1.5, 0.02, 0]])
    assert CLIMBER.holding.margins(wall, stretched) < 0
    assert StepSpace(CLIMBER, wall, min_margin=-10.0).is_free(stretched, 0.0)
    assert not StepSpace(CLIMBER, wall, min_margin=0.0).is_free(stretched, 0.0)


def test_a_weak_magnet_is_refused_as_holding():
    wall = Stance(A, SE3.from_z_axis(SOUTH, (0, -0.105, 10.6)))
    q = planned(at((0, -0.1, 10.85), SOUTH), wall, ZERO, CLIMBER).landing[-1]
    weak = Climber.of(MODEL, ORIGINAL, MagnetLimits(pull_n=100.0))
    with pytest.raises(RefusedError, match=r"^holding: foot A lets go before the step: (shear|tilt)"):
        planned(at((0, -0.1, 10.9), SOUTH), wall, q, weak)
    with pytest.raises(RefusedError, match=r"^holding: .*must be at least 0.9"):
        planned(at((0, -0.1, 10.9), SOUTH), wall, q, CLIMBER, PlannerConfig(min_margin=0.9))
