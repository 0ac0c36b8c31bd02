"""Inverse kinematics from where the robot is: the nearby posture that puts the free foot at a pose."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from shared.geometry import SE3, Float
from shared.messaging.messages import Foot
from shared.robot.jacobian import foot_and_jacobian
from shared.robot.kinematics import HYRECRO, IS_PRISMATIC, RobotGeometry

_TOLERANCE = 1e-10
"""Length of the remaining error, metres and radians taken alike, that counts as reached."""
_MAX_ITERATIONS = 60
_MAX_STEP_RAD = 0.5
_FIRST_DAMPING, _MAX_DAMPING = 1e-2, 1e6
_LEAST_DAMPING = 1e-12
_JOINT_SCALE = np.where(IS_PRISMATIC, HYRECRO.leg_m, 1.0)
"""A piston's metre counts as the angle that moves a foot as far about the leg's other end."""


def follow_pose(
    q_start: ArrayLike,
    T_fixed_free_goal: SE3,
    fixed_foot: Foot,
    lower: ArrayLike,
    upper: ArrayLike,
    geometry: RobotGeometry = HYRECRO,
) -> Float | None:
    """The posture (8,) near q_start (8,) with the free foot's plate at T_fixed_free_goal, or None if none was found.

    Every joint stays within lower..upper (8,); one that meets its limit waits there while the others go on. Each step
    is the shortest that removes the error, so joints that the pose leaves free hardly move. Meant for goals a small
    step away: from far it can stop short of a posture that exists, which `reach` finds.

    Source: Levenberg-Marquardt damped by the error's square (Yamashita & Fukushima 2001), bounds by an active set.
    """
    lower, upper = np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64)
    q = np.clip(np.asarray(q_start, dtype=np.float64), lower, upper)
    goal = T_fixed_free_goal.matrix
    T, J = foot_and_jacobian(q, fixed_foot, geometry)
    error = _pose_error(T, goal)
    size = math.sqrt(error @ error)
    damping = _FIRST_DAMPING
    for _ in range(_MAX_ITERATIONS):
        if size < _TOLERANCE:
            return q
        if damping > _MAX_DAMPING:
            return None
        step = _bounded_step(J, error, lower - q, upper - q, damping * size**2 + _LEAST_DAMPING)
        q_next = np.clip(q + step, lower, upper)
        T, J_next = foot_and_jacobian(q_next, fixed_foot, geometry)
        error_next = _pose_error(T, goal)
        size_next = math.sqrt(error_next @ error_next)
        if size_next < size:
            q, J, error, size = q_next, J_next, error_next, size_next
            damping /= 10
        else:
            damping *= 10
    return None


def _bounded_step(J: Float, error: Float, lowest: Float, highest: Float, damping: float) -> Float:
    """The shortest joint step (8,) within lowest..highest that removes the error (6,) as far as damping lets it."""
    J, lowest, highest = J * _JOINT_SCALE, lowest / _JOINT_SCALE, highest / _JOINT_SCALE
    step = np.zeros(8)
    is_free = np.ones(8, dtype=np.bool_)
    while is_free.any():
        J_free = J[:, is_free]
        left = error - J[:, ~is_free] @ step[~is_free]
        step[is_free] = J_free.T @ np.linalg.solve(J_free @ J_free.T + damping * np.eye(6), left)
        if is_free.all():
            step *= min(1.0, _MAX_STEP_RAD / max(float(np.abs(step).max()), 1e-300))
        is_beyond = is_free & ((step < lowest) | (step > highest))
        if not is_beyond.any():
            break
        step = np.where(is_beyond, np.clip(step, lowest, highest), step)
        is_free &= ~is_beyond
    scaled: Float = step * _JOINT_SCALE
    return scaled


def _pose_error(T: Float, goal: Float) -> Float:
    """What is missing from T (4, 4) to the goal (4, 4): metres, then the rotation vector, in the fixed frame (6,)."""
    R = goal[:3, :3] @ T[:3, :3].T
    twice_sine = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    sine, cosine = 0.5 * math.sqrt(twice_sine @ twice_sine), 0.5 * (R[0, 0] + R[1, 1] + R[2, 2] - 1)
    if sine > 1e-6:
        rotation = twice_sine * (0.5 * math.atan2(sine, cosine) / sine)
    elif cosine > 0:
        rotation = 0.5 * twice_sine
    else:  # half a turn, whose axis is not in the antisymmetric part
        rotation = SE3.projected(np.block([[R, np.zeros((3, 1))], [np.zeros((1, 3)), np.ones((1, 1))]])).log()[3:]
    return np.concatenate([goal[:3, 3] - T[:3, 3], rotation])
