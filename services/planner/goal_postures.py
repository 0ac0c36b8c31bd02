"""In which postures the robot can stand when the foot has landed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from services.planner.step_space import CONTACT_M, StepSpace
from shared.errors import RefusedError
from shared.geometry import SE3, Float
from shared.robot.inverse_kinematics import candidates
from shared.robot.limits import wraps_within
from shared.robot.reach import explain_unreachable, reach

_NUM_KEPT = 6
"""Postures to plan a way to; one is often in a corner that the others are not in."""
_LEAST_APART = 0.4
"""In radians or decimetres, so that those kept are not six times the same."""
_NUM_CHECKED = 256
"""Postures that are checked for collision at a time, cheapest first."""
_NUM_SEARCHED = 3
"""Poses whose surroundings are searched where the grid finds no posture at all, at 10 ms each."""
_TURN_OFF_RAD = 4e-3
"""A fixed foot that stands a little askew makes exact goals in its legs' plane unreachable: this counts as exact."""
_MARGIN_S = 2.0
"""Seconds of motion that a whole margin is worth."""
_AMPLE_MARGIN, _SHORT_S = 0.2, 5.0
"""Below this margin after the change of foot the next step has little choice: up to so many seconds worse."""
_FALL_S = 100.0
"""What it costs that the landed foot would not hold when it is the fixed one."""


def goal_postures(space: StepSpace, poses: Sequence[SE3], q_now: Float) -> Float:
    """Free postures (K, 8) with the free foot at one of the poses T_world_foot, best first.

    Best is the least time to go there at the velocity limits, plus what the magnets lack of their margin before and
    after the change of foot. Postures in which the landed foot would not hold come only where there are no others.

    Raises:
        RefusedError: unreachable, holding or collision, in this order, with what comes nearest.
    """
    q = _reached(space, poses)
    held = q[space.holds(q)]
    if not len(held):
        raise RefusedError(f"holding: foot {space.stance.fixed_foot.value} lets go there: {_overload(space, q)}")
    costs = _costs(space, held, q_now)
    order = np.argsort(costs, kind="stable")
    held, costs = held[order], costs[order]
    free = _first_free(space, held)
    if not len(free):
        raise RefusedError(f"collision: {_least_cut(space, held)}")
    lasting = [i for i in free if costs[i] < _FALL_S]
    kept: list[int] = []
    for i in lasting or free:
        if all(np.abs((held[i] - held[j]) * _SCALE).max() >= _LEAST_APART for j in kept):
            kept.append(i)
        if len(kept) == _NUM_KEPT:
            break
    chosen: Float = held[kept]
    return chosen


_SCALE = np.array([1, 10, 1, 1, 1, 1, 10, 1])


def _reached(space: StepSpace, poses: Sequence[SE3]) -> Float:
    stance, lower, upper = space.stance, space.climber.lower, space.climber.upper
    T_fixed_free = [stance.T_world_foot.inv() @ pose for pose in poses]
    grid = (np.linspace(lower[6], upper[6], 5), np.linspace(lower[7], upper[7], 49), np.linspace(-np.pi, np.pi, 25))
    found = [
        wraps_within(candidates(T, stance.fixed_foot, *grid, singular_rad=_TURN_OFF_RAD), lower, upper)
        for T in T_fixed_free
    ]
    if not any(map(len, found)):
        found = [
            reach(T, stance.fixed_foot, lower, upper, singular_rad=_TURN_OFF_RAD) for T in T_fixed_free[:_NUM_SEARCHED]
        ]
    q = np.concatenate(found)
    if not len(q):
        raise RefusedError(f"unreachable: {explain_unreachable(T_fixed_free[0], stance.fixed_foot, lower, upper)}")
    return q


def _costs(space: StepSpace, q: Float, q_now: Float) -> Float:
    """In seconds (N,)."""
    holding = space.climber.holding
    before, after = holding.margins(space.stance, q), holding.margins_after(space.stance, q)
    falls = np.where(after < space.min_margin, _FALL_S, 0.0)
    short = _SHORT_S * np.maximum(0.0, 1 - after / _AMPLE_MARGIN)
    costs: Float = space.duration_s(q_now, q) + _MARGIN_S * (2 - before - after) + short + falls
    return costs


def _first_free(space: StepSpace, q: Float) -> list[int]:
    """Indices of free ones among the first postures (N, 8) that have any."""
    free: list[int] = []
    for start in range(0, len(q), _NUM_CHECKED):
        depth_m = space.surroundings.contacts(q[start : start + _NUM_CHECKED]).depth_m
        free += (start + np.flatnonzero(depth_m <= CONTACT_M)).tolist()
        if len(free) >= _NUM_CHECKED // 2:
            break
    return free


def _overload(space: StepSpace, q: Float) -> str:
    best = q[np.argmax(space.climber.holding.margins(space.stance, q))]
    reason = space.climber.holding.overload(space.stance, best)
    margin = float(space.climber.holding.margins(space.stance, best))
    return reason or f"margin is at most {margin:.2f}, must be at least {space.min_margin:g}"


def _least_cut(space: StepSpace, q: Float) -> str:
    contacts = space.surroundings.contacts(q)
    i = int(contacts.depth_m.argmin())
    others = f" (the best of {len(q)} postures)" if len(q) > 1 else ""
    return f"{contacts.link[i]} would be {1e3 * contacts.depth_m[i]:.1f} mm inside {contacts.other[i]}{others}"
