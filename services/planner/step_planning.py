"""Plans a step: lift the free foot off along its normal, carry it over, land it along the normal."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np

from services.planner.footing import footings
from services.planner.goal_postures import goal_postures
from services.planner.step_space import CLEARANCES_M, CONTACT_M, StepSpace
from services.planner.tree_search import find_path, shortened
from shared.climbing.climber import Climber
from shared.climbing.stance import Stance
from shared.climbing.transit import line_samples
from shared.errors import RefusedError
from shared.geometry import SE3, Float
from shared.messaging.messages import FootTarget
from shared.robot.follow_pose import follow_pose
from shared.robot.kinematics import HYRECRO, IS_PRISMATIC
from shared.runtime.config import PlannerConfig

_PIECE_M = 5e-3
"""Length of the straight lines in joint space that make up a straight lift."""
_LEAST_LIFT_M = 0.01
_NUM_SHORTCUTS = 60
_SCALE = np.where(IS_PRISMATIC, HYRECRO.leg_m, 1.0)
_SPREAD = 0.7
"""Of random postures about the straight way, in radians and legs' lengths; every other one is from anywhere."""
_MAX_ERROR_M = 5e-3
"""Between where a foot stands and where the encoders put it."""
_VERIFY_M = 3e-3
_WANTED_MARGINS = (0.1, 0.05)
"""Tried before the least allowed margin: a foot that hardly holds after one step leaves no choice for the next."""
_WANT_SHARE = 4
"""They get so small a share of the search's iterations."""


@dataclass(frozen=True, slots=True, eq=False)
class StepPlan:
    """A step of the free foot of `stance`, as postures (N, 8) with straight lines in joint space between them.

    Each phase begins where the one before ends. T_world_goal: of the foot's plate. margin: the least on the way.
    """

    stance: Stance
    T_world_goal: SE3
    lift: Float
    transfer: Float
    landing: Float
    margin: float


def plan_step(
    target: FootTarget, stance: Stance, q_now: Float, climber: Climber, config: PlannerConfig, rng: np.random.Generator
) -> StepPlan:
    """The step that puts the free foot of `stance` where the target says, from posture q_now (8,).

    Raises:
        RefusedError: no flush steel there, unreachable, holding, collision: with what is in the way.
    """
    poses = footings(target, stance.T_world_free(q_now), climber.steel)
    _check_start(StepSpace(climber, stance, config.min_margin), q_now)
    for margin in _WANTED_MARGINS:
        with contextlib.suppress(RefusedError):
            if margin > config.min_margin:
                space = StepSpace(climber, stance, margin)
                return _plan(poses, space, q_now, config.lift_m, config.max_iterations // _WANT_SHARE, rng)
    space = StepSpace(climber, stance, config.min_margin)
    return _plan(poses, space, q_now, config.lift_m, config.max_iterations, rng)


def _plan(
    poses: list[SE3], space: StepSpace, q_now: Float, lift_m: float, max_iterations: int, rng: np.random.Generator
) -> StepPlan:
    """The step to one of the poses T_world_foot on which the margin never falls below the space's."""
    q_goals = goal_postures(space, poses, q_now)
    lift = next(_away(space, q_now, lift_m, _depth_at_start(space, q_now)), None)
    if lift is None:
        raise RefusedError(_why_not_along_normal(space, q_now, "lift off"))
    landings = [landing[::-1] for q in q_goals if (landing := next(_away(space, q, lift_m), None)) is not None]
    if not landings:
        raise RefusedError(_why_not_along_normal(space, q_goals[0], "land"))
    lasting = [landing for landing in landings if _can_go_on(space, landing[-1], lift_m)]
    transfer, landing = _transfer(space, lift[-1], lasting or landings, max_iterations, rng)
    margin = _least_margin(space, np.concatenate([lift, transfer, landing]))
    stance = space.stance
    return StepPlan(stance, stance.T_world_free(landing[-1]), lift, transfer, landing, margin)


def _check_start(space: StepSpace, q: Float) -> None:
    foot, holding = space.stance.fixed_foot.value, space.climber.holding
    if (reason := holding.overload(space.stance, q)) is not None:
        raise RefusedError(f"holding: foot {foot} lets go before the step: {reason}")


def _away(space: StepSpace, q: Float, lift_m: float, depth_m: float = CONTACT_M) -> Iterator[Float]:
    """Ways (N, 8) that take the free foot off along its normal, the highest first, and are in nothing by depth_m."""
    for height_m in (lift_m, max(lift_m / 2, _LEAST_LIFT_M), _LEAST_LIFT_M):
        way = _lifted(space, q, height_m)
        if way is not None and space.is_free(_with_middles(way), -depth_m) and space.is_free(way[-1:], 0.0):
            yield way


def _can_go_on(space: StepSpace, q: Float, lift_m: float) -> bool:
    """Whether the foot that is fixed now could be lifted next, with the other one fixed in posture q (8,)."""
    next_space = StepSpace(space.climber, space.stance.changed(q), space.min_margin)
    return next(_away(next_space, q, lift_m), None) is not None


def _depth_at_start(space: StepSpace, q: Float) -> float:
    """What a foot that lifts may be in its steel: by encoders that err it seems to be deeper than it is."""
    depth_m = float(space.surroundings.contacts(q[None]).depth_m[0])
    return CONTACT_M + min(max(depth_m, 0.0), _MAX_ERROR_M)


def _with_middles(way: Float) -> Float:
    return np.concatenate([way, (way[:-1] + way[1:]) / 2])


def _lifted(space: StepSpace, q: Float, height_m: float) -> Float | None:
    """Postures (N, 8) along the normal of the free foot, or None where the joints do not go that far."""
    stance, climber = space.stance, space.climber
    T_fixed_free = stance.T_world_foot.inv() @ stance.T_world_free(q)
    way = [q]
    for height in np.linspace(0, height_m, round(height_m / _PIECE_M) + 1)[1:]:
        goal = T_fixed_free @ SE3.trans(z_m=height)
        q_next = follow_pose(way[-1], goal, stance.fixed_foot, climber.lower, climber.upper)
        if q_next is None:
            return None
        way.append(q_next)
    return np.array(way)


def _transfer(
    space: StepSpace, q_lifted: Float, landings: list[Float], max_iterations: int, rng: np.random.Generator
) -> tuple[Float, Float]:
    """The free way from q_lifted to the start of one of the landings, and that landing; with the most clearance."""
    for clearance_m in CLEARANCES_M:
        if not space.is_free(q_lifted[None], clearance_m):
            continue
        reachable = [landing for landing in landings if space.is_free(landing[:1], clearance_m)]
        is_way_free = partial(space.is_way_free, clearance_m=clearance_m)
        for landing in reachable:
            if is_way_free(q_lifted, landing[0]):
                return np.array([q_lifted, landing[0]]), landing
        if not reachable:
            continue
        q_goals = np.array([landing[0] for landing in reachable])
        path = _search(space, q_lifted, q_goals, clearance_m, max_iterations // len(CLEARANCES_M), rng)
        if path is not None:
            return path, next(landing for landing in reachable if (landing[0] == path[-1]).all())
    kind, reason = _obstacle(space, _samples(space, q_lifted, landings[0][0]), 0.0)
    raise RefusedError(f"{kind}: no free way found after {max_iterations} iterations; on the straight one {reason}")


def _search(
    space: StepSpace,
    q_start: Float,
    q_goals: Float,
    clearance_m: float,
    max_iterations: int,
    rng: np.random.Generator,
) -> Float | None:
    lower, upper = space.climber.lower, space.climber.upper
    is_way_free = partial(space.is_way_free, clearance_m=clearance_m)

    def draw() -> Float:
        if rng.random() < 0.5:
            return rng.uniform(lower, upper)
        middle = q_start + rng.random() * (q_goals[rng.integers(len(q_goals))] - q_start)
        return np.asarray(np.clip(middle + _SPREAD * _SCALE * rng.standard_normal(8), lower, upper))

    path = find_path(q_start, q_goals, _SCALE, is_way_free, draw, max_iterations)
    return None if path is None else shortened(path, is_way_free, rng, _NUM_SHORTCUTS)


def _least_margin(space: StepSpace, path: Float) -> float:
    ways = [_samples(space, a, b) for a, b in pairwise(path)]
    return space.climber.holding.worst(space.stance, np.concatenate(ways))[1]


def _samples(space: StepSpace, q_start: Float, q_end: Float) -> Float:
    return line_samples(q_start, q_end, space.stance, space.climber.collisions.bodies, _VERIFY_M)


def _why_not_along_normal(space: StepSpace, q: Float, verb: str) -> str:
    """What a foot meets that leaves from (or comes to) q along its normal by the least height."""
    way = _lifted(space, q, _LEAST_LIFT_M)
    kind, reason = "unreachable", f"the joints do not go {1e3 * _LEAST_LIFT_M:g} mm along its normal"
    if way is not None:
        kind, reason = _obstacle(space, _with_middles(way), CONTACT_M)
    return f"{kind}: foot {space.stance.free_foot.value} cannot {verb} along its normal: {reason}"


def _obstacle(space: StepSpace, samples: Float, depth_m: float) -> tuple[str, str]:
    """What is in the way of postures (S, 8) that may cut in by depth_m: kind and text of a refusal."""
    contacts = space.surroundings.contacts(samples)
    i = contacts.deepest()
    if contacts.depth_m[i] > depth_m:
        return "collision", f"{contacts.link[i]} cuts {1e3 * contacts.depth_m[i]:.1f} mm into {contacts.other[i]}"
    foot, holding = space.stance.fixed_foot.value, space.climber.holding
    worst, margin = holding.worst(space.stance, samples)
    if margin < space.min_margin:
        reason = holding.overload(space.stance, samples[worst])
        return "holding", reason or f"margin of foot {foot} is {margin:.2f}, must be at least {space.min_margin:g}"
    return "collision", "there is no room beside it"
