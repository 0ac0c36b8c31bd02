"""The robot's ten actuators and the eight joints of its serial equivalent.

Each leg is two parallel modules on one core link: module 1 at the foot, module 2 at the hip. The core link can slide
between them while nothing else moves; how far is a leg's slide, y1 - y2, which no joint shows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from shared.geometry import Float
from shared.messaging.messages import ACTUATOR_NAMES
from shared.robot.kinematics import HYRECRO, joint_values
from shared.robot.limits import beyond_limits
from shared.robot.parallel_module import MODULE, ModuleGeometry, pistons_from_platform, platform_from_pistons

_LEFT = np.array([0, 2, 6, 8])
_RIGHT = _LEFT + 1
_PISTONS = np.array([0, 1, 2, 3, 6, 7, 8, 9])
_HIP_ANGLES = np.array([4, 5])
_TILT_JOINTS = np.array([0, 2, 5, 7])
_TURN_JOINTS = np.array([3, 4])
_LENGTH_JOINTS = np.array([1, 6])
_MODULES_AT_FEET = np.array([0, 3])
_MODULES_AT_HIP = np.array([1, 2])


@dataclass(frozen=True, slots=True, kw_only=True)
class ActuatorGeometry:
    """How the modules make up the legs, in metres."""

    module: ModuleGeometry = MODULE
    core_link_m: float = 0.245
    """Assumed so that pistons at mid-stroke, 0.22 m, mean q2 = q7 = 0; remembered from the papers is 0.16, with which
    the robot's group simulates legs shorter than its strokes allow."""
    leg_m: float = HYRECRO.leg_m


ACTUATORS = ActuatorGeometry()


def joints_from_actuators(values: ArrayLike, geometry: ActuatorGeometry = ACTUATORS) -> tuple[Float, Float]:
    """q (..., 8) and the slides y1 - y2 of legs A and B (..., 2) in metres, for values (..., 10) by ACTUATOR_NAMES.

    What a module decides is NaN where its pistons do not fit together; `actuator_refusals` says so. Tilts of more
    than about 88 degrees, far beyond the strokes, are another assembly of the module and come back as a smaller tilt.

    Raises:
        ValueError: the values are not (..., 10).
    """
    values = _actuator_values(values)
    y, phi = platform_from_pistons(values[..., _LEFT], values[..., _RIGHT], geometry.module)
    at_feet, at_hip = y[..., _MODULES_AT_FEET], y[..., _MODULES_AT_HIP]
    q = np.empty((*values.shape[:-1], 8))
    q[..., _TILT_JOINTS] = phi
    q[..., _TURN_JOINTS] = values[..., _HIP_ANGLES]
    q[..., _LENGTH_JOINTS] = at_feet + at_hip - geometry.core_link_m - geometry.leg_m
    return q, at_feet - at_hip


def actuators_from_joints(
    q: ArrayLike, slides_m: ArrayLike = (0.0, 0.0), geometry: ActuatorGeometry = ACTUATORS
) -> Float:
    """Values (..., 10) by ACTUATOR_NAMES for q (..., 8) and slides_m (..., 2). Strokes are not considered.

    Raises:
        ValueError: q is not (..., 8).
    """
    q, slides_m = joint_values(q), np.asarray(slides_m, dtype=np.float64)
    both_m = q[..., _LENGTH_JOINTS] + geometry.leg_m + geometry.core_link_m
    y = np.empty((*both_m.shape[:-1], 4))
    y[..., _MODULES_AT_FEET] = (both_m + slides_m) / 2
    y[..., _MODULES_AT_HIP] = (both_m - slides_m) / 2
    values = np.empty((*both_m.shape[:-1], 10))
    values[..., _LEFT], values[..., _RIGHT] = pistons_from_platform(y, q[..., _TILT_JOINTS], geometry.module)
    values[..., _HIP_ANGLES] = q[..., _TURN_JOINTS]
    return values


def actuator_refusals(values: ArrayLike, geometry: ActuatorGeometry = ACTUATORS) -> list[str]:
    """Why the pistons of values (10,) cannot be so: one text for each beyond its stroke, or module that does not close.

    The turns of the hip have the limits of q4 and q5, which the robot's description states.

    Raises:
        ValueError: the values are not (10,).
    """
    values = _actuator_values(values)
    if values.ndim != 1:
        raise ValueError(f"actuator values must be (10,), got {values.shape}")
    strokes = np.full(8, geometry.module.min_piston_m), np.full(8, geometry.module.max_piston_m)
    names = [ACTUATOR_NAMES[i] for i in _PISTONS]
    reasons = beyond_limits(names, values[_PISTONS], *strokes, ["m"] * 8)
    y, _ = platform_from_pistons(values[_LEFT], values[_RIGHT], geometry.module)
    for i in np.flatnonzero(np.isnan(y)):
        left, right = _LEFT[i], _RIGHT[i]
        reasons.append(
            f"{ACTUATOR_NAMES[left]} and {ACTUATOR_NAMES[right]} are {values[left]:g} and {values[right]:g} m, "
            "with which the module does not close"
        )
    return reasons


def _actuator_values(values: ArrayLike) -> Float:
    array = np.asarray(values, dtype=np.float64)
    if array.shape[-1:] != (len(ACTUATOR_NAMES),):
        raise ValueError(f"actuator values must be (..., {len(ACTUATOR_NAMES)}), got {array.shape}")
    return array
