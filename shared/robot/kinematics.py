"""Kinematics of the robot's serial equivalent, RPR-RR-RPR: eight joints from foot A over the hip to foot B.

`footA`, `footB` and `hip` stand for the centres of those plates, z from a foot's sole towards the robot. The frames of
the URDF's links sit on the joints' axes instead, so the plates of its `hip` and `foot_b` are beside their origins.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce

import numpy as np
from numpy.typing import ArrayLike

from shared.geometry import SE3
from shared.messaging.messages import JOINT_NAMES, Foot


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotGeometry:
    """Lengths of the robot in metres.

    Source: the serial-equivalent model in the simulation of the robot's group (Peidro, Gil, Marin, Paya, Reinoso; UMH
    Elche).
    """

    plate_to_axis_m: float = 0.025
    """From the centre of a foot or platform plate to the revolute axis of its leg."""
    leg_m: float = 0.195
    """From one revolute axis of a leg to the other, where q2 or q7 is zero."""
    hip_axes_m: float = 0.150
    """Between the two axes about which the legs turn against the hip."""
    hip_height_m: float = 0.020
    """From the centre of a platform plate up to the middle of the hip plate."""

    @property
    def T_hip_plate(self) -> SE3:
        """The hip plate's centre in the frame of link `hip`."""
        return SE3.trans(x_m=self.hip_axes_m / 2)

    def T_link_foot(self, foot: Foot) -> SE3:
        """The foot plate's centre in the frame of its link."""
        return SE3.identity() if foot is Foot.A else SE3.trans(z_m=-self.plate_to_axis_m)


HYRECRO = RobotGeometry()

FOOT_LINKS = {Foot.A: "foot_a", Foot.B: "foot_b"}


def link_transforms(q: ArrayLike, geometry: RobotGeometry = HYRECRO) -> dict[str, SE3]:
    """T_parent_child of each moving link by the child's name, in order from foot A's link to foot B's.

    q: (8,) radians, metres for q2 and q7; positive values of these lengthen the legs.

    Raises:
        ValueError: q is not (8,).
    """
    values = np.asarray(q, dtype=np.float64)
    if values.shape != (len(JOINT_NAMES),):
        raise ValueError(f"q must be ({len(JOINT_NAMES)},), got {values.shape}")
    q1, q2, q3, q4, q5, q6, q7, q8 = values.tolist()
    plate, leg, hip = geometry.plate_to_axis_m, geometry.leg_m, geometry.hip_height_m
    return {
        "leg_a_lower": SE3.trans(z_m=plate) @ SE3.rot("y", -q1),
        "leg_a_upper": SE3.trans(z_m=leg + q2),
        "platform_a": SE3.rot("y", -q3),
        "hip": SE3.trans(z_m=plate + hip) @ SE3.rot("z", q4),
        "platform_b": SE3.trans(x_m=geometry.hip_axes_m, z_m=-hip) @ SE3.rot("z", q5),
        "leg_b_upper": SE3.trans(z_m=-plate) @ SE3.rot("y", -q6),
        "leg_b_lower": SE3.trans(z_m=-leg - q7),
        "foot_b": SE3.rot("y", -q8),
    }


def T_footA_hip(q: ArrayLike, geometry: RobotGeometry = HYRECRO) -> SE3:
    """The centre of the hip plate, x along its long side from leg A to leg B, seen from foot A."""
    links = link_transforms(q, geometry)
    to_hip = ("leg_a_lower", "leg_a_upper", "platform_a", "hip")
    return reduce(SE3.compose, (links[name] for name in to_hip)) @ geometry.T_hip_plate


def T_footA_footB(q: ArrayLike, geometry: RobotGeometry = HYRECRO) -> SE3:
    """The centre of foot B's plate seen from foot A's."""
    return reduce(SE3.compose, link_transforms(q, geometry).values()) @ geometry.T_link_foot(Foot.B)


def T_fixed_free(q: ArrayLike, fixed_foot: Foot, geometry: RobotGeometry = HYRECRO) -> SE3:
    """The free foot's plate seen from the fixed foot's."""
    T = T_footA_footB(q, geometry)
    return T if fixed_foot is Foot.A else T.inv()
