"""Turns a joint command into a target of all joints, or says exactly why not."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from shared.errors import RefusedError
from shared.messaging.messages import JointTarget
from shared.robot.description import Joint

_MAX_DURATION_S = 86_400.0
"""A day."""


def resolve_target(target: JointTarget, joints: Sequence[Joint], q_before: NDArray[np.float64]) -> NDArray[np.float64]:
    """Where all joints (J,) shall go; those the command does not name keep their value of `q_before`.

    Raises:
        RefusedError: wrong number of values, unknown or repeated names, beyond a joint's limits, unusable duration.
    """
    all_names = [joint.name for joint in joints]
    names = all_names if target.names is None else list(target.names)
    _check_names(names, all_names, len(target.q))
    if target.duration_s is not None and not 0 < target.duration_s <= _MAX_DURATION_S:
        raise RefusedError(f"duration_s is {target.duration_s:g}, must be above 0 and at most {_MAX_DURATION_S:g}")
    q = q_before.copy()
    q[[all_names.index(name) for name in names]] = target.q
    reasons = [reason for joint, value in zip(joints, q, strict=True) if (reason := _beyond_limits(joint, value))]
    if reasons:
        raise RefusedError("; ".join(reasons))
    return q


def _check_names(names: list[str], all_names: list[str], num_values: int) -> None:
    for name, count in Counter(names).items():
        if name not in all_names:
            raise RefusedError(f"unknown joint '{name}'; joints are {', '.join(all_names)}")
        if count > 1:
            raise RefusedError(f"joint '{name}' is named {count} times")
    if num_values != len(names) or not names:
        raise RefusedError(f"q has {num_values} values, {len(names) or 'at least 1'} expected ({', '.join(names)})")


def _beyond_limits(joint: Joint, value: float) -> str:
    assert joint.limits is not None
    if joint.limits.lower <= value <= joint.limits.upper:
        return ""
    unit = "m" if joint.kind == "prismatic" else "rad"
    return f"{joint.name} is {value:g} {unit}, must be within {joint.limits.lower:g}..{joint.limits.upper:g} {unit}"
