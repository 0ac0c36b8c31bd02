"""Closed-form inverse kinematics of the eight joints.

Six of the joints follow from the pose of one foot to the other and two that are free, q7 and q8. With alpha = q1 + q3,
gamma = q4 + q5 and beta = q6 + q8 the rotation is Ry(-alpha) Rz(gamma) Ry(-beta). It leaves two signs: s1, that of
sin(gamma), and s2, that of cos(q4). Where sin(gamma) = 0, as in every posture with both legs in one plane, only
alpha + beta or alpha - beta is given, and alpha is a third free value; s1 then makes no difference.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shared.geometry import SE3, Float
from shared.messaging.messages import Foot
from shared.robot.kinematics import HYRECRO, RobotGeometry

BRANCHES = ((1, 1), (1, -1), (-1, 1), (-1, -1))
"""(s1, s2) in the order in which `solve_batch` returns them."""

SINGULAR = 1e-9
"""sin(gamma) up to which alpha is taken as free; the foot's orientation is off by no more than this."""
_SINE_ROUNDING = 1e-12
"""By how much sin(q4) may exceed 1, by rounding, before there is no solution."""
_SINE_IS_ONE = 2e-15
"""sin(q4) closer to 1 than this is 1: arcsin would make 6e-8 rad out of rounding errors."""


def solve_batch(
    T_footA_footB: ArrayLike, q7: ArrayLike, q8: ArrayLike, alpha: ArrayLike = 0.0, geometry: RobotGeometry = HYRECRO
) -> Float:
    """Postures (..., 4, 8) by branch that put foot B at T_footA_footB (..., 4, 4); NaN where a branch has none.

    q7 in metres, q8 and alpha in radians are (...) and broadcast with each other and with the poses; alpha = q1 + q3
    counts only where sin(gamma) is below SINGULAR, and the branches with s1 = -1 are NaN there. Angles are within
    -pi..pi. Joint limits are not considered. Within d of sin(gamma) = 0 or cos(q4) = 0 joints are exact to 1e-15 / d
    only, the foot's pose always to 1e-9.

    Raises:
        ValueError: the shapes do not fit.
    """
    T = np.asarray(T_footA_footB, dtype=np.float64)
    if T.shape[-2:] != (4, 4):
        raise ValueError(f"T_footA_footB must be (..., 4, 4), got {T.shape}")
    free = [np.asarray(value, dtype=np.float64) for value in (q7, q8, alpha)]
    shape = np.broadcast_shapes(T.shape[:-2], *(value.shape for value in free))
    q7, q8, alpha = (np.broadcast_to(value, shape)[..., None] for value in free)
    s1, s2 = np.array(BRANCHES, dtype=np.float64).T
    R, p = T[..., None, :3, :3], T[..., None, :3, 3]

    alpha, beta, gamma, is_solution = _rotation_angles(R, s1, alpha)
    hip_b = _hip_b(R, p, q7, q8, beta, geometry)
    sine = hip_b[..., 1] / geometry.hip_axes_m
    is_solution = is_solution & (np.abs(sine) <= 1 + _SINE_ROUNDING)
    sine = np.where(np.abs(sine) > 1 - _SINE_IS_ONE, np.sign(sine), np.where(is_solution, sine, 0.0))
    q4 = np.where(s2 > 0, np.arcsin(sine), np.pi - np.arcsin(sine))
    q1, q2 = _leg_a(hip_b, alpha, q4, geometry)
    q = np.stack(
        np.broadcast_arrays(q1, q2, _wrap(alpha - q1), _wrap(q4), _wrap(gamma - q4), _wrap(beta - q8), q7, q8), axis=-1
    )
    return np.where(is_solution[..., None], q, np.nan)


def _rotation_angles(R: Float, s1: Float, free_alpha: Float) -> tuple[Float, Float, Float, NDArray[np.bool_]]:
    """alpha, beta, gamma and whether the branch exists, each (..., 4).

    beta and gamma come from what alpha leaves of R, so that near sin(gamma) = 0 they make up for its rounding errors.
    """
    r12, r32 = R[..., 0, 1], R[..., 2, 1]
    is_singular = np.hypot(r12, r32) < SINGULAR
    alpha = np.where(is_singular, free_alpha, np.arctan2(-s1 * r32, -s1 * r12))
    c, s = np.cos(alpha), np.sin(alpha)
    beta = np.arctan2(c * R[..., 2, 0] - s * R[..., 0, 0], c * R[..., 2, 2] - s * R[..., 0, 2])
    gamma = np.arctan2(-(c * r12 + s * r32), R[..., 1, 1] + np.zeros_like(alpha))
    return alpha, beta, gamma, ~is_singular | (s1 > 0)


def _hip_b(R: Float, p: Float, q7: Float, q8: Float, beta: Float, geometry: RobotGeometry) -> Float:
    """Where q5's axis meets platform B's plate, in foot A's frame (..., 4, 3)."""
    plate, leg = geometry.plate_to_axis_m, geometry.leg_m + q7
    x = leg * np.sin(q8) + plate * np.sin(beta)
    z = leg * np.cos(q8) + plate * np.cos(beta) + plate
    hip_b: Float = p + R[..., 0] * x[..., None] + R[..., 2] * z[..., None]
    return hip_b


def _leg_a(hip_b: Float, alpha: Float, q4: Float, geometry: RobotGeometry) -> tuple[Float, Float]:
    """q1 and q2, each (..., 4), from where leg A's upper axis has to be."""
    plate, reach_x = geometry.plate_to_axis_m, geometry.hip_axes_m * np.cos(q4)
    c, s = np.cos(alpha), np.sin(alpha)
    x = hip_b[..., 0] - reach_x * c + plate * s
    z = hip_b[..., 2] - reach_x * s - plate * c - plate
    return -np.arctan2(x, z), np.hypot(x, z) - geometry.leg_m


def _wrap(angle: Float) -> Float:
    """Into -pi..pi; what is inside stays exactly as it is."""
    return np.where(np.abs(angle) > np.pi, angle - 2 * np.pi * np.round(angle / (2 * np.pi)), angle)


def solve(T_footA_footB: SE3, q7: float, q8: float, alpha: float = 0.0, geometry: RobotGeometry = HYRECRO) -> Float:
    """Postures (K, 8), K at most 4, that put foot B's plate at T_footA_footB; see `solve_batch`."""
    q = solve_batch(T_footA_footB.matrix, q7, q8, alpha, geometry)
    return q[~np.isnan(q).any(axis=1)]


def candidates(
    T_fixed_free: SE3,
    fixed_foot: Foot,
    q7: ArrayLike,
    q8: ArrayLike,
    alpha: ArrayLike,
    geometry: RobotGeometry = HYRECRO,
) -> Float:
    """Postures (K, 8), limits not considered, for every pair of the values q7 (N,) in metres and q8 (M,) in radians.

    Where alpha is free every alpha (A,) in radians is tried as well.
    """
    T_footA_footB = (T_fixed_free if fixed_foot is Foot.A else T_fixed_free.inv()).matrix
    is_singular = bool(np.hypot(T_footA_footB[0, 1], T_footA_footB[2, 1]) < SINGULAR)
    alphas = np.atleast_1d(alpha) if is_singular else np.zeros(1)
    free = np.meshgrid(np.atleast_1d(q7), np.atleast_1d(q8), alphas, indexing="ij")
    q = solve_batch(T_footA_footB, free[0], free[1], free[2], geometry).reshape(-1, 8)
    return q[~np.isnan(q).any(axis=1)]
