"""Whether the magnet of the foot that the robot stands on holds it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from shared.climbing.stance import Stance
from shared.errors import InputFileError
from shared.geometry import Float
from shared.robot.adhesion import MagnetLimits, margin, overload
from shared.robot.description import UrdfModel
from shared.robot.statics import RobotMasses, holding_wrench


@dataclass(frozen=True, slots=True)
class Holding:
    """The robot's masses and its magnets' limits."""

    masses: RobotMasses
    limits: MagnetLimits

    @classmethod
    def of(cls, model: UrdfModel, limits: MagnetLimits | None = None) -> Holding:
        """Of a robot, with the published magnets where no others are given.

        Raises:
            InputFileError: the model has a mass that belongs to no moving link.
        """
        try:
            return cls(RobotMasses.from_urdf(model), limits or MagnetLimits())
        except ValueError as error:
            raise InputFileError(f"robot '{model.name}': {error}") from error

    def margins(self, stance: Stance, q: ArrayLike) -> Float:
        """What is left of the magnet's limits (...) at rest in q (..., 8): 1 unloaded, below 0 the foot lets go."""
        return margin(self._wrench(stance, q), self.limits)

    def margins_after(self, stance: Stance, q: ArrayLike) -> Float:
        """The same of the foot that is free now, were it the fixed one, in each posture (...)."""
        rotations = stance.free_matrices(q)[..., :3, :3]
        return margin(holding_wrench(q, stance.free_foot, rotations, self.masses), self.limits)

    def overload(self, stance: Stance, q: ArrayLike) -> str | None:
        """Which limit the posture q (8,) is beyond, with load and limit; None if the foot holds."""
        return overload(self._wrench(stance, q), self.limits)

    def worst(self, stance: Stance, q: Float) -> tuple[int, float]:
        """Which of the postures q (S, 8) has the least margin, and that margin."""
        margins = self.margins(stance, q)
        i = int(np.argmin(margins))
        return i, float(margins[i])

    def _wrench(self, stance: Stance, q: ArrayLike) -> Float:
        return holding_wrench(q, stance.fixed_foot, stance.T_world_foot.rotation, self.masses)
