"""One robot on one structure: everything that planning and checking ask of the two."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from shared.climbing.collision import CollisionModel
from shared.climbing.holding import Holding
from shared.climbing.steel import SteelSurface
from shared.geometry import Float
from shared.messaging.messages import JOINT_NAMES
from shared.robot.adhesion import MagnetLimits
from shared.robot.configured import robot_urdf
from shared.robot.description import UrdfModel
from shared.robot.limits import joint_bounds
from shared.robot.urdf import parse_urdf
from shared.runtime.config import Config
from shared.world.files import load_structure
from shared.world.structure import Structure


@dataclass(frozen=True, slots=True, eq=False)
class Climber:
    """lower, upper (8,): joint limits in radians, metres for q2 and q7; max_velocity (8,): the same a second."""

    lower: Float
    upper: Float
    max_velocity: Float
    collisions: CollisionModel
    holding: Holding
    steel: SteelSurface

    @classmethod
    def of(cls, model: UrdfModel, structure: Structure, magnets: MagnetLimits | None = None) -> Climber:
        """Of a robot and a structure; the published magnets where no others are given.

        Raises:
            InputFileError: collision shapes or masses are not usable.
        """
        lower, upper = joint_bounds(model)
        velocities = np.array([model.limits[name].velocity for name in JOINT_NAMES])
        collisions, holding = CollisionModel(model, structure), Holding.of(model, magnets)
        return cls(lower, upper, velocities, collisions, holding, SteelSurface(structure))


def load_climber(config: Config) -> Climber:
    """The configuration's robot, with its magnets, on the configuration's structure.

    Raises:
        InputFileError, ConfigError: one of the files is not usable, or a sensor cannot be mounted.
    """
    magnets = config.sim.magnets
    limits = MagnetLimits(pull_n=magnets.pull_n, half_width_m=magnets.half_width_m, friction=magnets.friction)
    model = parse_urdf(robot_urdf(config), str(config.robot))
    return Climber.of(model, load_structure(config.structure), limits)
