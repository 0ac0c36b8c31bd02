"""The robot at rest under gravity: what its fixed foot must bear and what its joints must hold."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from shared.geometry import SE3, Float
from shared.messaging.messages import Foot
from shared.robot.description import UrdfModel
from shared.robot.kinematics import HYRECRO, IS_PRISMATIC, JOINT_AXES, LINKS, RobotGeometry, link_matrices

GRAVITY_MPS2 = 9.81


@dataclass(frozen=True, slots=True, eq=False)
class RobotMasses:
    """Of each of LINKS the mass (9,) in kg and the centre of mass (9, 3) in the link's frame in metres; read-only.

    Raises:
        ValueError: wrong shapes, a negative mass, or a value that is not finite.
    """

    mass_kg: Float
    centre_m: Float

    def __post_init__(self) -> None:
        mass, centre = np.array(self.mass_kg, dtype=np.float64), np.array(self.centre_m, dtype=np.float64)
        if mass.shape != (len(LINKS),) or centre.shape != (len(LINKS), 3):
            raise ValueError(f"masses must be ({len(LINKS)},) and ({len(LINKS)}, 3), got {mass.shape}, {centre.shape}")
        if not (np.isfinite(mass).all() and np.isfinite(centre).all() and (mass >= 0).all()):
            raise ValueError("masses must be finite and not negative, centres finite")
        mass.setflags(write=False)
        centre.setflags(write=False)
        object.__setattr__(self, "mass_kg", mass)
        object.__setattr__(self, "centre_m", centre)

    @classmethod
    def from_urdf(cls, model: UrdfModel) -> RobotMasses:
        """The model's masses; a link that is fixed to one of LINKS, as the sensor is, counts as part of that link.

        Raises:
            ValueError: a link with a mass belongs to none of LINKS.
        """
        mass, moment = np.zeros(len(LINKS)), np.zeros((len(LINKS), 3))
        for name, inertia in model.inertias.items():
            link, T_link_name = _moving_link(model, name)
            i = LINKS.index(link)
            mass[i] += inertia.mass_kg
            moment[i] += inertia.mass_kg * (T_link_name @ inertia.T_link_mass).translation
        return cls(mass, moment / np.where(mass > 0, mass, 1.0)[:, None])

    @property
    def total_kg(self) -> float:
        """Of the whole robot."""
        return float(self.mass_kg.sum())


def _moving_link(model: UrdfModel, name: str) -> tuple[str, SE3]:
    """Which of LINKS the link `name` is a rigid part of, and T_link_name."""
    joint_of = {joint.child: joint for joint in model.joints}
    link, T = name, SE3.identity()
    while link not in LINKS:
        joint = joint_of.get(link)
        if joint is None or joint.kind != "fixed":
            raise ValueError(f"link '{name}' has a mass and is fixed to none of {', '.join(LINKS)}")
        link, T = joint.parent, joint.T_parent_joint @ T
    return link, T


def holding_wrench(
    q: ArrayLike,
    fixed_foot: Foot,
    R_world_fixed: ArrayLike,
    masses: RobotMasses,
    gravity_mps2: float = GRAVITY_MPS2,
    geometry: RobotGeometry = HYRECRO,
) -> Float:
    """Wrench (..., 6) of the steel on the fixed foot of a robot at rest in q (..., 8): force in N, moment in Nm.

    In the frame of the fixed foot's plate, the moment about the sole's centre; standing on a floor the force is upward.
    R_world_fixed (3, 3) or (..., 3, 3) turns that frame into the world's, where gravity is along -z.

    Raises:
        ValueError: q is not (..., 8).
    """
    T_footA_link = link_matrices(q, geometry)
    centres = _centres(T_footA_link, masses)
    if fixed_foot is Foot.B:
        T_footA_footB = T_footA_link[..., -1, :, :] @ geometry.T_link_foot(Foot.B).matrix
        centres = (centres - T_footA_footB[..., None, :3, 3]) @ T_footA_footB[..., :3, :3]
    gravity = _gravity_in(np.asarray(R_world_fixed, dtype=np.float64), gravity_mps2)
    lever_kgm = masses.mass_kg @ (centres - geometry.T_foot_sole.translation)
    moment = -np.cross(lever_kgm, gravity)
    return np.concatenate([np.broadcast_to(-masses.total_kg * gravity, moment.shape), moment], axis=-1)


def gravity_efforts(
    q: ArrayLike,
    fixed_foot: Foot,
    R_world_fixed: ArrayLike,
    masses: RobotMasses,
    gravity_mps2: float = GRAVITY_MPS2,
    geometry: RobotGeometry = HYRECRO,
) -> Float:
    """Efforts (..., 8) with which the joints hold q (..., 8) at rest: Nm, N for q2 and q7, along the joints' axes.

    They are the derivatives of the potential energy. R_world_fixed as for `holding_wrench`.

    Raises:
        ValueError: q is not (..., 8).
    """
    T_footA_link = link_matrices(q, geometry)
    gravity = _gravity_in(np.asarray(R_world_fixed, dtype=np.float64), gravity_mps2)
    if fixed_foot is Foot.B:
        R_A_B = T_footA_link[..., -1, :3, :3]
        gravity = (R_A_B @ gravity[..., None])[..., 0]
    weighted = masses.mass_kg[:, None] * _centres(T_footA_link, masses)
    towards_b = fixed_foot is Foot.A  # the joint carries the links on its free side: those after it, or those before it
    carried_kgm = _carried(weighted, towards_b, axis=-2)
    carried_kg = _carried(masses.mass_kg, towards_b, axis=-1)
    T_footA_child = T_footA_link[..., 1:, :, :]
    axes = (T_footA_child[..., :3, :3] @ JOINT_AXES[:, :, None])[..., 0]
    levers_kgm = carried_kgm - carried_kg[:, None] * T_footA_child[..., :3, 3]
    turning = np.cross(levers_kgm, gravity[..., None, :])
    sliding = carried_kg[:, None] * gravity[..., None, :]
    efforts: Float = (axes * np.where(IS_PRISMATIC[:, None], sliding, turning)).sum(axis=-1)
    return -efforts if towards_b else efforts


def _carried(values: Float, towards_b: bool, axis: int) -> Float:
    """For each joint the sum over the links after it, or over those before it."""
    if towards_b:
        after: Float = np.flip(np.cumsum(np.flip(values, axis), axis), axis)
        return after.take(np.arange(1, len(LINKS)), axis)
    before: Float = np.cumsum(values, axis)
    return before.take(np.arange(len(LINKS) - 1), axis)


def _centres(T_footA_link: Float, masses: RobotMasses) -> Float:
    """Centres of mass (..., 9, 3) in foot A's frame."""
    centres: Float = (T_footA_link[..., :3, :3] @ masses.centre_m[:, :, None])[..., 0] + T_footA_link[..., :3, 3]
    return centres


def _gravity_in(R_world_frame: Float, gravity_mps2: float) -> Float:
    """Gravity (..., 3) in m/s^2 in the frame."""
    down: Float = -gravity_mps2 * R_world_frame[..., 2, :]
    return down
