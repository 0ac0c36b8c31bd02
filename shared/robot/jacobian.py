"""Geometric Jacobian of the robot: how the free foot moves with the joints."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from shared.geometry import Float
from shared.messaging.messages import Foot
from shared.robot.kinematics import HYRECRO, IS_PRISMATIC, JOINT_AXES, RobotGeometry, link_matrices


def foot_jacobian(q: ArrayLike, fixed_foot: Foot, geometry: RobotGeometry = HYRECRO) -> Float:
    """Jacobian (..., 6, 8) of the free foot's plate centre in the fixed foot's frame, for q (..., 8).

    Rows: velocity of the plate's centre in m/s, then angular velocity in rad/s, per rad/s (m/s for q2 and q7) of each
    joint. Rank 5 where both legs' planes coincide (sin(q4 + q5) = 0), for three parallel axes of rotation remain.

    Raises:
        ValueError: q is not (..., 8).

    Source: Siciliano et al., Robotics: Modelling, Planning and Control, section 3.1.
    """
    return foot_and_jacobian(q, fixed_foot, geometry)[1]


def foot_and_jacobian(q: ArrayLike, fixed_foot: Foot, geometry: RobotGeometry = HYRECRO) -> tuple[Float, Float]:
    """T_fixed_free (..., 4, 4) of the plates' centres, and `foot_jacobian` (..., 6, 8) there."""
    T_footA_link = link_matrices(q, geometry)
    T_footA_footB = T_footA_link[..., -1, :, :] @ geometry.T_link_foot(Foot.B).matrix
    J = _foot_b_jacobian(T_footA_link[..., 1:, :, :], T_footA_footB)
    if fixed_foot is Foot.A:
        return T_footA_footB, J
    R_B_A = T_footA_footB[..., :3, :3].swapaxes(-1, -2)
    origin_in_B = -(R_B_A @ T_footA_footB[..., :3, 3:])
    T_footB_footA = np.zeros_like(T_footA_footB)
    T_footB_footA[..., :3, :3], T_footB_footA[..., :3, 3:], T_footB_footA[..., 3, 3] = R_B_A, origin_in_B, 1.0
    w = -(R_B_A @ J[..., 3:, :])
    v = -(R_B_A @ J[..., :3, :]) + _cross(w, origin_in_B)
    return T_footB_footA, np.concatenate([v, w], axis=-2)


def _foot_b_jacobian(T_footA_child: Float, T_footA_footB: Float) -> Float:
    """(..., 6, 8) from the joints' child links (..., 8, 4, 4), whose origins are on the joints' axes."""
    axes = (T_footA_child[..., :3, :3] @ JOINT_AXES[:, :, None])[..., 0].swapaxes(-1, -2)
    levers = T_footA_footB[..., :3, 3:] - T_footA_child[..., :3, 3].swapaxes(-1, -2)
    v = np.where(IS_PRISMATIC, axes, _cross(axes, levers))
    return np.concatenate([v, np.where(IS_PRISMATIC, 0.0, axes)], axis=-2)


def _cross(a: Float, b: Float) -> Float:
    """Of columns: (..., 3, N) x (..., 3, N or 1); `np.cross` is ten times slower for one posture."""
    ax, ay, az = a[..., 0, :], a[..., 1, :], a[..., 2, :]
    bx, by, bz = b[..., 0, :], b[..., 1, :], b[..., 2, :]
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-2)
