"""Postures for a step in the plane of both legs, with the legs mirrored: q = (q1, q2, q3, 0, 0, q3, q2, q1).

Foot B then stands step_m from foot A along a line that rises by half the pitch, and is pitched against foot A about y.
With a = -q1 and b = -(q1 + q3) = pitch / 2: step_m / 2 = leg sin(a - b) - plate_to_axis sin(b) + hip_axes / 2.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from shared.errors import RefusedError
from shared.geometry import Float
from shared.robot.kinematics import HYRECRO, RobotGeometry, joint_values


def symmetric_posture(
    step_m: float, pitch_rad: float = 0.0, extension_m: float = 0.0, geometry: RobotGeometry = HYRECRO
) -> Float:
    """q (8,) that puts foot B at step_m (cos(pitch / 2), 0, -sin(pitch / 2)), pitched by pitch_rad about foot A's y.

    extension_m: q2 and q7. Joint limits are not considered.

    Raises:
        RefusedError: the legs are too short for it.
    """
    b = pitch_rad / 2
    across_m = step_m / 2 + geometry.plate_to_axis_m * math.sin(b) - geometry.hip_axes_m / 2
    leg_m = geometry.leg_m + extension_m
    if not abs(across_m) <= leg_m:
        raise RefusedError(
            f"a step of {step_m:g} m with a pitch of {pitch_rad:g} rad needs legs of {abs(across_m):.4g} m, "
            f"they are {leg_m:.4g} m where q2 and q7 are {extension_m:g} m"
        )
    q3 = math.asin(across_m / leg_m)
    q1 = -b - q3
    return np.array([q1, extension_m, q3, 0.0, 0.0, q3, extension_m, q1])


def symmetric_step(q: ArrayLike, geometry: RobotGeometry = HYRECRO) -> tuple[Float, Float]:
    """step_m and pitch_rad, each (...), of symmetric postures q (..., 8).

    Raises:
        ValueError: q is not (..., 8), or not symmetric within 1e-9.
    """
    q = joint_values(q)
    mirrored = q[..., [7, 6, 5, 3, 4, 2, 1, 0]] * [1, 1, 1, 0, 0, 1, 1, 1]
    if np.abs(q - mirrored).max(initial=0.0) > 1e-9:
        raise ValueError("q must be (q1, q2, q3, 0, 0, q3, q2, q1) for a symmetric step")
    b = -(q[..., 0] + q[..., 2])
    half_m = (geometry.leg_m + q[..., 1]) * np.sin(q[..., 2]) - geometry.plate_to_axis_m * np.sin(b)
    return 2 * half_m + geometry.hip_axes_m, 2 * b
