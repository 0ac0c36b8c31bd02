"""Kinematics of the robot's serial equivalent, RPR-RR-RPR: eight joints from foot A over the hip to foot B.

`footA`, `footB` and `hip` stand for the centres of those plates, z from a foot's sole towards the robot. The frames of
the URDF's links sit on the joints' axes instead, so the plates of its `hip` and `foot_b` are beside their origins.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from shared.geometry import SE3, Float
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
    sole_below_plate_m: float = 0.005
    """From the centre of a foot's plate to its sole's, along the plate's -z: half of the plate's thickness."""
    sole_half_width_m: float = 0.05
    """Of the square sole."""

    @property
    def T_hip_plate(self) -> SE3:
        """The hip plate's centre in the frame of link `hip`."""
        return SE3.trans(x_m=self.hip_axes_m / 2)

    @property
    def T_foot_sole(self) -> SE3:
        """The sole's centre in the frame of a foot's plate."""
        return SE3.trans(z_m=-self.sole_below_plate_m)

    def T_link_foot(self, foot: Foot) -> SE3:
        """The foot plate's centre in the frame of its link."""
        return SE3.identity() if foot is Foot.A else SE3.trans(z_m=-self.plate_to_axis_m)


HYRECRO = RobotGeometry()

FOOT_LINKS = {Foot.A: "foot_a", Foot.B: "foot_b"}

LINKS = (
    "foot_a",
    "leg_a_lower",
    "leg_a_upper",
    "platform_a",
    "hip",
    "platform_b",
    "leg_b_upper",
    "leg_b_lower",
    "foot_b",
)
"""The moving links from foot A to foot B; joint i of JOINT_NAMES moves LINKS[i + 1] against LINKS[i]."""

JOINT_AXES = np.array(
    [[0, -1, 0], [0, 0, 1], [0, -1, 0], [0, 0, 1], [0, 0, 1], [0, -1, 0], [0, 0, -1], [0, -1, 0]], dtype=np.float64
)
"""(8, 3) unit axis of each joint in its child link's frame."""
IS_PRISMATIC = np.array([False, True, False, False, False, False, True, False])
"""(8,) q2 and q7 slide, the others turn."""
for _constant in (JOINT_AXES, IS_PRISMATIC):
    _constant.setflags(write=False)

_TURN = np.cross(np.eye(3), np.where(IS_PRISMATIC[:, None], 0.0, JOINT_AXES)[:, None, :])
_TURN_TWICE = _TURN @ _TURN
_SLIDE = np.where(IS_PRISMATIC[:, None], JOINT_AXES, 0.0)


def parent_child_matrices(q: ArrayLike, geometry: RobotGeometry = HYRECRO) -> Float:
    """T_parent_child (..., 8, 4, 4) of LINKS[1:] for q (..., 8) in radians, metres for q2 and q7.

    Raises:
        ValueError: q is not (..., 8).
    """
    q = joint_values(q)
    angles = q[..., None, None]
    T = np.zeros((*q.shape, 4, 4))
    T[..., :3, :3] = np.eye(3) + np.sin(angles) * _TURN + (1 - np.cos(angles)) * _TURN_TWICE  # Rodrigues
    T[..., :3, 3] = _link_origins(geometry) + q[..., None] * _SLIDE
    T[..., 3, 3] = 1.0
    return T


def _link_origins(geometry: RobotGeometry) -> Float:
    """Of LINKS[1:] in their parents (8, 3) where the joints are zero."""
    plate, leg, hip = geometry.plate_to_axis_m, geometry.leg_m, geometry.hip_height_m
    origins = np.zeros((8, 3))
    origins[:, 2] = plate, leg, 0.0, plate + hip, -hip, -plate, -leg, 0.0
    origins[4, 0] = geometry.hip_axes_m
    return origins


def link_matrices(q: ArrayLike, geometry: RobotGeometry = HYRECRO) -> Float:
    """T_footA_link (..., 9, 4, 4) of LINKS for q (..., 8) in radians, metres for q2 and q7.

    Raises:
        ValueError: q is not (..., 8).
    """
    T_parent_child = parent_child_matrices(q, geometry)
    T = np.empty((*T_parent_child.shape[:-3], 9, 4, 4))
    T[..., 0, :, :] = np.eye(4)
    for i in range(8):
        np.matmul(T[..., i, :, :], T_parent_child[..., i, :, :], out=T[..., i + 1, :, :])
    return T


def foot_matrices(q: ArrayLike, geometry: RobotGeometry = HYRECRO) -> Float:
    """T_footA_footB (..., 4, 4), between the plates' centres, for q (..., 8).

    Raises:
        ValueError: q is not (..., 8).
    """
    T: Float = link_matrices(q, geometry)[..., -1, :, :] @ geometry.T_link_foot(Foot.B).matrix
    return T


def joint_values(q: ArrayLike) -> Float:
    """`q` as float64 (..., 8).

    Raises:
        ValueError: it has another shape.
    """
    values = np.asarray(q, dtype=np.float64)
    if values.shape[-1:] != (len(JOINT_NAMES),):
        raise ValueError(f"q must be (..., {len(JOINT_NAMES)}), got {values.shape}")
    return values


def link_transforms(q: ArrayLike, geometry: RobotGeometry = HYRECRO) -> dict[str, SE3]:
    """T_parent_child of each moving link by the child's name, in order from foot A's link to foot B's.

    q: (8,) radians, metres for q2 and q7; positive values of these lengthen the legs.

    Raises:
        ValueError: q is not (8,).
    """
    matrices = parent_child_matrices(_one_posture(q), geometry)
    return {link: SE3.from_matrix(T) for link, T in zip(LINKS[1:], matrices, strict=True)}


def T_footA_hip(q: ArrayLike, geometry: RobotGeometry = HYRECRO) -> SE3:
    """The centre of the hip plate, x along its long side from leg A to leg B, seen from foot A."""
    return SE3.from_matrix(link_matrices(_one_posture(q), geometry)[LINKS.index("hip")]) @ geometry.T_hip_plate


def T_footA_footB(q: ArrayLike, geometry: RobotGeometry = HYRECRO) -> SE3:
    """The centre of foot B's plate seen from foot A's."""
    return SE3.from_matrix(foot_matrices(_one_posture(q), geometry))


def T_fixed_free(q: ArrayLike, fixed_foot: Foot, geometry: RobotGeometry = HYRECRO) -> SE3:
    """The free foot's plate seen from the fixed foot's."""
    T = T_footA_footB(q, geometry)
    return T if fixed_foot is Foot.A else T.inv()


def _one_posture(q: ArrayLike) -> Float:
    values = np.asarray(q, dtype=np.float64)
    if values.shape != (len(JOINT_NAMES),):
        raise ValueError(f"q must be ({len(JOINT_NAMES)},), got {values.shape}")
    return values
