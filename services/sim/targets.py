"""Turns a command into a target of all joints or actuators, or says exactly why not."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from shared.errors import RefusedError
from shared.messaging.messages import ACTUATOR_NAMES, JOINT_NAMES, ActuatorTarget, JointTarget
from shared.robot.actuators import (
    ActuatorGeometry,
    actuator_refusals,
    actuators_from_joints,
    joints_from_actuators,
)
from shared.robot.limits import JOINT_UNITS, beyond_limits

Joints = NDArray[np.float64]

_MAX_DURATION_S = 86_400.0
"""A day."""


def resolve_joints(target: JointTarget, q_before: Joints, lower: Joints, upper: Joints) -> Joints:
    """Where all joints (8,) shall go; those the command does not name keep their value of `q_before`.

    Raises:
        RefusedError: wrong number of values, unknown or repeated names, beyond a joint's limits, unusable duration.
    """
    _check_duration("duration_s", target.duration_s)
    _check_duration("valid_s", target.valid_s)
    q = _merged("joint", "q", JOINT_NAMES, target.names, target.q, q_before)
    _refuse(beyond_limits(JOINT_NAMES, q, lower, upper, JOINT_UNITS))
    return q


def resolve_actuators(
    target: ActuatorTarget,
    q_before: Joints,
    slides_before: NDArray[np.float64],
    lower: Joints,
    upper: Joints,
    geometry: ActuatorGeometry,
) -> tuple[Joints, NDArray[np.float64]]:
    """Where all joints (8,) and the slides (2,) shall go; actuators the command does not name stay where they are.

    Raises:
        RefusedError: as for joints, and beyond an actuator's stroke.
    """
    _check_duration("duration_s", target.duration_s)
    before = actuators_from_joints(q_before, slides_before, geometry)
    values = _merged("actuator", "positions", ACTUATOR_NAMES, target.names, target.positions, before)
    _refuse(actuator_refusals(values, geometry))
    q, slides = joints_from_actuators(values, geometry)
    _refuse(beyond_limits(JOINT_NAMES, q, lower, upper, JOINT_UNITS, "would be"))
    return q, slides


def _merged(
    what: str,
    field: str,
    all_names: Sequence[str],
    some_names: Sequence[str] | None,
    values: NDArray[np.float64],
    before: NDArray[np.float64],
) -> NDArray[np.float64]:
    names = list(all_names if some_names is None else some_names)
    for name, count in Counter(names).items():
        if name not in all_names:
            raise RefusedError(f"unknown {what} '{name}'; {what}s are {', '.join(all_names)}")
        if count > 1:
            raise RefusedError(f"{what} '{name}' is named {count} times")
    if len(values) != len(names) or not names:
        raise RefusedError(
            f"{field} has {len(values)} values, {len(names) or 'at least 1'} expected ({', '.join(names)})"
        )
    merged = before.copy()
    merged[[all_names.index(name) for name in names]] = values
    return merged


def _check_duration(field: str, duration_s: float | None) -> None:
    if duration_s is not None and not 0 < duration_s <= _MAX_DURATION_S:
        raise RefusedError(f"{field} is {duration_s:g}, must be above 0 and at most {_MAX_DURATION_S:g}")


def _refuse(reasons: list[str]) -> None:
    if reasons:
        raise RefusedError("; ".join(reasons))
