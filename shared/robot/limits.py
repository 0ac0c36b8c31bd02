"""Limits of joints and actuators: what is beyond them, said with name, value and what is allowed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from shared.geometry import Float
from shared.messaging.messages import JOINT_NAMES
from shared.robot.description import UrdfModel
from shared.robot.kinematics import IS_PRISMATIC, joint_values

JOINT_UNITS = tuple("m" if slides else "rad" for slides in IS_PRISMATIC)

LIMIT_TOLERANCE = 1e-9
"""Radians or metres by which rounding may take a computed joint beyond its limit."""


def joint_bounds(model: UrdfModel) -> tuple[Float, Float]:
    """Lower and upper positions (8,) of q1 to q8 in radians or metres.

    Raises:
        ValueError: the model has no joint of one of these names that moves.
    """
    missing = [name for name in JOINT_NAMES if name not in model.limits]
    if missing:
        raise ValueError(
            f"robot '{model.name}' has no joint {', '.join(missing)}; joints are {', '.join(model.limits)}"
        )
    limits = [model.limits[name] for name in JOINT_NAMES]
    return np.array([limit.lower for limit in limits]), np.array([limit.upper for limit in limits])


def beyond_limits(
    names: Sequence[str], values: ArrayLike, lower: ArrayLike, upper: ArrayLike, units: Sequence[str], verb: str = "is"
) -> list[str]:
    """One text for each of the values (N,) that is outside lower..upper (N,), or no number; empty if none is."""
    columns = (np.asarray(column, dtype=np.float64).tolist() for column in (values, lower, upper))
    return [
        f"{name} {verb} {value:.6g} {unit}, must be within {low:g}..{high:g} {unit}"
        for name, unit, value, low, high in zip(names, units, *columns, strict=True)
        if not low <= value <= high
    ]


def wraps_within(q: ArrayLike, lower: ArrayLike, upper: ArrayLike, tolerance: float = LIMIT_TOLERANCE) -> Float:
    """Every posture (K, 8) that is one of q (N, 8) up to full turns of the revolute joints, and inside the limits (8,).

    A joint that is beyond a limit by no more than `tolerance` radians or metres is set to that limit. Where a joint's
    range is more than a turn, one posture can come back as several. Rows with NaN do not come back.
    """
    found = joint_values(q).reshape(-1, 8)
    lower, upper = np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64)
    for i in range(8):
        turned = [found]
        if not IS_PRISMATIC[i]:
            turn = 2 * np.pi * np.eye(8)[i]
            turned = [found, found - turn, found + turn]
        found = np.concatenate(turned)
        inside = (found[:, i] >= lower[i] - tolerance) & (found[:, i] <= upper[i] + tolerance)
        found = found[inside & ~np.isnan(found).any(axis=1)]
    return np.clip(found, lower, upper)
