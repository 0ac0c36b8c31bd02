"""The actuators that stand behind the joints: their geometry as configured, and how they move."""

from __future__ import annotations

import numpy as np

from shared.geometry import Float
from shared.robot.actuators import ActuatorGeometry, actuators_from_joints
from shared.robot.parallel_module import ModuleGeometry
from shared.runtime.config import ActuatorConfig


def actuator_geometry(config: ActuatorConfig) -> ActuatorGeometry:
    """The actuators of a configuration."""
    module = ModuleGeometry(
        base_half_m=config.base_half_m,
        platform_half_m=config.platform_half_m,
        min_piston_m=config.min_piston_m,
        max_piston_m=config.max_piston_m,
    )
    return ActuatorGeometry(module=module, core_link_m=config.core_link_m)


def actuator_motion(
    q: Float, dq: Float, slides: Float, dslides: Float, geometry: ActuatorGeometry
) -> tuple[Float, Float]:
    """Positions and velocities (10,) of the actuators, the velocities by a difference over a millisecond.

    q, dq: (8,) of the joints; slides, dslides: (2,) of the core links.
    """
    half_s = 5e-4
    times = np.array([[0.0], [-half_s], [half_s]])
    now, before, after = actuators_from_joints(q + times * dq, slides + times * dslides, geometry)
    return now, (after - before) / (2 * half_s)
