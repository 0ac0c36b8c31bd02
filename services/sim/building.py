"""The body that a configuration asks for, and the checks of the robot it is made of."""

from __future__ import annotations

import numpy as np

from services.sim.body import Body
from services.sim.dynamic_body import DynamicBody
from services.sim.kinematic_body import KinematicBody
from services.sim.slip import Slip
from shared.climbing.steel import SteelSurface
from shared.errors import InputFileError
from shared.geometry import SE3
from shared.messaging.messages import JOINT_NAMES
from shared.robot.description import UrdfModel
from shared.robot.kinematics import FOOT_LINKS
from shared.runtime.config import SimConfig
from shared.world.structure import Structure


def build_body(config: SimConfig, urdf_text: str, model: UrdfModel, structure: Structure, slip: Slip) -> Body:
    """The body of the configured mode, at its initial place.

    Raises:
        InputFileError: pybullet cannot load the URDF.
    """
    T_world_foot = SE3.from_rpy(np.deg2rad(config.initial_foot_rpy_deg), config.initial_foot_xyz_m)
    if config.mode == "dynamic":
        return DynamicBody(urdf_text, model, structure, config, T_world_foot, slip)
    return KinematicBody(urdf_text, model, SteelSurface(structure), config, T_world_foot, slip)


def check_robot(model: UrdfModel, source: str) -> None:
    """Raises:
    InputFileError: joints or links are missing, or joints are there that are not this robot's.
    """
    for what, has, needs in (("joints", model.limits, JOINT_NAMES), ("links", model.links, FOOT_LINKS.values())):
        if missing := [name for name in needs if name not in has]:
            raise InputFileError(f"{source}: {what} {', '.join(missing)} are missing; it has {', '.join(has)}")
    if extra := [name for name in model.limits if name not in JOINT_NAMES]:
        raise InputFileError(f"{source}: unknown joints {', '.join(extra)}; only {', '.join(JOINT_NAMES)} may move")


def generators(seed: int) -> list[np.random.Generator]:
    """One each for the encoders and the slips, so that neither's draws disturb the other's."""
    return np.random.default_rng(seed).spawn(2)
