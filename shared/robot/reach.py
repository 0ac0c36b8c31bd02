"""Postures within the limits that put the free foot at a pose, or what is in the way, its value and its limit."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from shared.geometry import SE3, Float
from shared.messaging.messages import JOINT_NAMES, Foot
from shared.robot.follow_pose import follow_pose
from shared.robot.inverse_kinematics import candidates
from shared.robot.kinematics import HYRECRO, IS_PRISMATIC, RobotGeometry
from shared.robot.limits import JOINT_UNITS, LIMIT_TOLERANCE, beyond_limits, wraps_within

_REFINEMENTS = 4
_POINTS_PER_REFINEMENT = 7


def reach(
    T_fixed_free: SE3,
    fixed_foot: Foot,
    lower: ArrayLike,
    upper: ArrayLike,
    q7: ArrayLike | None = None,
    q8: ArrayLike | None = None,
    alpha: ArrayLike | None = None,
    geometry: RobotGeometry = HYRECRO,
) -> Float:
    """Postures (K, 8) within lower..upper (8,) that put the free foot at T_fixed_free; K = 0 if none was found.

    Over a grid: q7 (N,) in metres, q8 (M,) and alpha (A,) in radians are the values to try (`inverse_kinematics` says
    what alpha is); None spreads 5, 65 and 33 of them over what the limits allow. If there are none on the grid, but
    one beside it, that one.
    """
    lower, upper = np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64)
    grid = _free_values(lower, upper)
    q7, q8, alpha = (default if given is None else given for given, default in zip((q7, q8, alpha), grid, strict=True))
    found = wraps_within(candidates(T_fixed_free, fixed_foot, q7, q8, alpha, geometry), lower, upper)
    if len(found):
        return found
    closest = _closest_posture(T_fixed_free, fixed_foot, lower, upper, geometry)
    beside = None if closest is None else _beside(closest, T_fixed_free, fixed_foot, lower, upper, geometry)
    return found if beside is None else beside[None]


def explain_unreachable(
    T_fixed_free: SE3, fixed_foot: Foot, lower: ArrayLike, upper: ArrayLike, geometry: RobotGeometry = HYRECRO
) -> str:
    """Why no posture within lower..upper (8,) puts the free foot at T_fixed_free; empty if one does after all.

    Names the joints of the posture that comes closest to the limits: `q2 would be 0.0832 m, must be within
    -0.025..0.025 m`. Joints are compared as if a leg's length were a radian.
    """
    lower, upper = np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64)
    distance_m = float(np.linalg.norm(T_fixed_free.translation))
    longest_m = 4 * geometry.plate_to_axis_m + 2 * geometry.leg_m + upper[1] + upper[6] + geometry.hip_axes_m
    if distance_m > longest_m:
        return (
            f"the free foot would be {distance_m:.4g} m from the fixed one, {distance_m - longest_m:.4g} m farther "
            f"than legs and hip are long together ({longest_m:.4g} m)"
        )
    q = _closest_posture(T_fixed_free, fixed_foot, lower, upper, geometry)
    if q is None:
        return f"leg B would start farther from leg A's plane than the hip is long ({geometry.hip_axes_m:g} m)"
    if _beside(q, T_fixed_free, fixed_foot, lower, upper, geometry) is not None:
        return ""
    return "; ".join(beyond_limits(JOINT_NAMES, q, lower, upper, JOINT_UNITS, "would be"))


def _beside(
    q: Float, T_fixed_free: SE3, fixed_foot: Foot, lower: Float, upper: Float, geometry: RobotGeometry
) -> Float | None:
    """A posture (8,) within the limits at that pose, near q, which is at that pose but may be beyond them."""
    is_inside = (_beyond(q, lower, upper) <= LIMIT_TOLERANCE).all()
    inside = np.clip(q, lower, upper)
    return inside if is_inside else follow_pose(inside, T_fixed_free, fixed_foot, lower, upper, geometry)


def _closest_posture(
    T_fixed_free: SE3, fixed_foot: Foot, lower: Float, upper: Float, geometry: RobotGeometry
) -> Float | None:
    """The posture (8,) at that pose that is least beyond the limits, over a grid that is refined about its best."""
    grid = list(_free_values(lower, upper))
    best: Float | None = None
    for _ in range(1 + _REFINEMENTS):
        found = candidates(T_fixed_free, fixed_foot, grid[0], grid[1], grid[2], geometry)
        if best is not None:
            found = np.concatenate([best[None], found])
        if not len(found):
            return None
        found = _least_turns_beyond(found, lower, upper)
        best = found[np.argmin(_beyond(found, lower, upper) @ np.where(IS_PRISMATIC, 1 / geometry.leg_m, 1.0))]
        centres = (best[6], best[7], best[0] + best[2])
        spacings = [np.ptp(values) / max(len(values) - 1, 1) for values in grid]
        grid = [
            centre + spacing * np.linspace(-1, 1, _POINTS_PER_REFINEMENT)
            for centre, spacing in zip(centres, spacings, strict=True)
        ]
        grid[0], grid[1] = np.clip(grid[0], lower[6], upper[6]), np.clip(grid[1], lower[7], upper[7])
    return best


def _least_turns_beyond(q: Float, lower: Float, upper: Float) -> Float:
    """Postures (N, 8) with each angle turned full turns to be inside its limits, or as little beyond as can be."""
    turned = q + np.where(IS_PRISMATIC, 0.0, 2 * np.pi) * np.array([0, -1, 1])[:, None, None]
    least: Float = np.take_along_axis(turned, _beyond(turned, lower, upper).argmin(axis=0)[None], axis=0)[0]
    return least


def _beyond(q: Float, lower: Float, upper: Float) -> Float:
    excess: Float = np.maximum(np.maximum(lower - q, q - upper), 0.0)
    return excess


def _free_values(lower: Float, upper: Float) -> tuple[Float, Float, Float]:
    """5 values of q7, 65 of q8, 33 of alpha = q1 + q3, evenly over what the limits (8,) allow, ends included."""
    alpha_lower, alpha_upper = (max(-np.pi, lower[0] + lower[2]), min(np.pi, upper[0] + upper[2]))
    return (
        np.linspace(lower[6], upper[6], 5),
        np.linspace(lower[7], upper[7], 65),
        np.linspace(alpha_lower, alpha_upper, 33),
    )
