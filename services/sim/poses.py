"""Many poses at once, (N, 7) x y z in metres and quaternion x y z w, where one `SE3` each would cost too much."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Poses = NDArray[np.float64]


def composed_poses(T_a_b: Poses, T_b_c: Poses) -> Poses:
    """T_a_c of each row."""
    xyz = T_a_b[:, :3] + _rotated(T_a_b[:, 3:], T_b_c[:, :3])
    return np.hstack([xyz, _product(T_a_b[:, 3:], T_b_c[:, 3:])])


def inverse_poses(T_a_b: Poses) -> Poses:
    """T_b_a of each row."""
    conjugate = T_a_b[:, 3:] * (-1.0, -1.0, -1.0, 1.0)
    return np.hstack([_rotated(conjugate, -T_a_b[:, :3]), conjugate])


def _rotated(q: Poses, v: Poses) -> Poses:
    u, w = q[:, :3], q[:, 3:]
    t = 2.0 * _cross(u, v)
    return v + w * t + _cross(u, t)


def _product(p: Poses, q: Poses) -> Poses:
    u, a, v, b = p[:, :3], p[:, 3:], q[:, :3], q[:, 3:]
    w = a * b - np.sum(u * v, axis=1, keepdims=True)
    return np.hstack([a * v + b * u + _cross(u, v), w])


def _cross(u: Poses, v: Poses) -> Poses:
    return u[:, [1, 2, 0]] * v[:, [2, 0, 1]] - u[:, [2, 0, 1]] * v[:, [1, 2, 0]]  # np.cross takes 5 times as long
