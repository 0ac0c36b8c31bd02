import numpy as np
import pytest

from shared.climbing.climb_check import ClimbCheck, ClimbLimits, Row
from shared.climbing.climber import Climber
from shared.climbing.stance import Stance
from shared.geometry import SE3
from shared.messaging.messages import Foot
from shared.robot.adhesion import MagnetLimits
from shared.solids import Box
from shared.world.structure import Member
from tests.support.postures import MODEL
from tests.support.steel import BEAM, structure

ON_BEAM = Stance(Foot.A, SE3.trans(z_m=0.005))
ZERO = np.zeros(8)
STEP = np.array([-0.6, 0, 0.6, 0, 0, 0.6, 0, -0.6])
"""Foot B stands flush 0.37 m from foot A; on the straight way from zero it stays above the beam."""
CHANGE = None


def reports(*rows, members=(BEAM,), stance=ON_BEAM, limits=None):
    check = ClimbCheck(Climber.of(MODEL, structure(*members)), limits)
    numbered = [Row(line, None if q is CHANGE else np.asarray(q, dtype=float)) for line, q in enumerate(rows, start=2)]
    return list(check.reports(numbered, stance, ZERO))


def test_a_step_along_a_beam_is_fine():
    start, move = reports(STEP)
    assert (start.kind, move.kind, move.line, move.foot) == ("start", "move", 2, Foot.B)
    assert (start.problems, move.problems) == ((), ())
    assert move.landing.members == ("beam",)
    assert abs(move.landing.gap_m) < 1e-9


def test_a_cut_is_told_with_place_link_member_and_depth():
    """The foot slides along the beam, through a ridge of 10 mm, and ends behind it."""
    ridge = Member("ridge", Box((0.02, 0.2, 0.02)), SE3.trans(0.26))
    _, move = reports(STEP, members=(BEAM, ridge))
    assert (move.cut.link, move.cut.other) == ("foot_b", "ridge")
    assert move.cut.depth_m == pytest.approx(0.010, abs=1e-9)
    assert 0.1 < move.cut.share < 0.9
    assert move.problems == (f"foot_b cuts 10.0 mm into ridge at {100 * move.cut.share:.0f} % of the way",)


def test_ten_millimetres_of_cut_are_ten_millimetres():
    """The hip rises and sinks on a vertical line through the fixed foot; a ceiling is 10 mm below its highest point."""
    up = np.array([0, 0.02, 0, 0, 0, 0, 0.02, 0])
    ceiling = Member("ceiling", Box((1.0, 1.0, 0.1)), SE3.trans(z_m=0.005 + 0.265 + 0.078 + 0.02 - 0.01 + 0.05))
    _, rise, sink = reports(up, ZERO, members=(BEAM, ceiling))
    assert (rise.cut.link, rise.cut.other, rise.cut.share) == ("lidar", "ceiling", 1.0)
    assert rise.cut.depth_m == pytest.approx(0.010, abs=1e-9)
    assert sink.cut.share == 0.0
    assert rise.problems == ("lidar cuts 10.0 mm into ceiling at 100 % of the way",)
    _, rise, _ = reports(up, ZERO, members=(BEAM, ceiling), limits=ClimbLimits(max_depth_m=0.0101))
    assert rise.problems == ()


def test_only_the_last_move_before_a_change_must_land():
    lifted = STEP + np.array([0, 0, 0.3, 0, 0, 0, 0, 0])
    rows = reports(lifted, STEP, CHANGE)
    assert [row.landing is None for row in rows] == [False, True, False, True]
    assert all(row.problems == () for row in rows)
    _, hanging, change = reports(lifted, CHANGE)
    assert "foot B" in " ".join(hanging.problems)
    assert change.problems == ()


def test_a_change_without_a_move_judges_the_foot_that_becomes_fixed():
    _, change = reports(CHANGE)
    assert (change.kind, change.foot, change.problems) == ("change", Foot.B, ())
    narrow = Member("narrow", Box((0.1, 0.1, 0.1)), SE3.trans(z_m=-0.05))
    _, change = reports(CHANGE, members=(narrow,))
    assert change.problems == ("foot B ends 100 mm from any steel",)


def test_feet_take_turns():
    back = np.zeros(8)
    _, first, change, second = reports(STEP, CHANGE, back)
    assert (first.foot, change.foot, second.foot) == (Foot.B, Foot.B, Foot.A)
    assert second.landing.gap_m == pytest.approx(0, abs=1e-9)
    assert second.problems == ()


def test_limits_name_joint_value_and_range():
    _, move = reports([2.0, 0, 0, 0, 0, 0, 0.03, 0])
    assert move.limits[0].startswith("q1 is 2 rad, must be within -1.57")
    assert move.limits[1] == "q7 is 0.03 m, must be within -0.025..0.025 m"
    assert set(move.limits) <= set(move.problems)


@pytest.mark.parametrize(
    ("T_world_foot", "problem"),
    [
        (SE3.trans(z_m=0.006), "foot A ends 1.00 mm above beam"),
        (SE3.trans(z_m=0.003), "foot A ends 2.00 mm sunk into beam"),
        (SE3.trans(z_m=0.005) @ SE3.rot("x", np.deg2rad(0.6)), "foot A is tilted by 0.60 deg"),
        (SE3.trans(y_m=0.1, z_m=0.005), "only 60 % of the sole of foot A is over steel"),
        (SE3.trans(z_m=0.505), "foot A ends 500 mm from any steel"),
    ],
)
def test_a_bad_stand_is_named(T_world_foot, problem):
    start, _ = reports(CHANGE, stance=Stance(Foot.A, T_world_foot))
    assert problem in start.problems


def test_thresholds_can_be_set():
    start, _ = reports(CHANGE, stance=Stance(Foot.A, SE3.trans(z_m=0.006)), limits=ClimbLimits(max_gap_m=0.0011))
    assert start.problems == ()


def test_the_margin_is_the_least_on_the_way_and_says_what_lets_go():
    wall = Stance(Foot.A, SE3.rot("y", np.pi / 2) @ SE3.trans(z_m=0.005))
    bar = Member("bar", Box((0.2, 0.2, 2.0)), SE3.trans(-0.1))
    rows = reports(STEP, CHANGE, members=(bar,), stance=wall)
    assert [0 < row.margin < 1 for row in rows] == [True, True, True]
    weak = MagnetLimits(pull_n=80.0)
    check = ClimbCheck(Climber.of(MODEL, structure(bar), weak))
    start, _ = check.reports([Row(2, STEP)], wall, ZERO)
    assert start.margin < 0
    assert any("foot A lets go: shear" in problem or "foot A lets go: tilt" in problem for problem in start.problems)
    start, move = ClimbCheck(Climber.of(MODEL, structure(bar)), ClimbLimits(min_margin=0.99)).reports(
        [Row(2, STEP)], wall, ZERO
    )
    assert start.problems == ("foot A lets go: margin must be at least 0.99",)
    assert "% of the way: margin must be" in move.problems[0]
