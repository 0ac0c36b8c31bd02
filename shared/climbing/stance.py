"""Where the robot stands: one foot fixed somewhere in the world, from which the joints place everything else."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from shared.geometry import SE3, Float
from shared.messaging.messages import Foot
from shared.robot.kinematics import HYRECRO, T_fixed_free, foot_matrices, link_matrices


@dataclass(frozen=True, slots=True, eq=False)
class Stance:
    """The fixed foot, and T_world_foot of its plate's centre."""

    fixed_foot: Foot
    T_world_foot: SE3

    @property
    def free_foot(self) -> Foot:
        """The foot that moves."""
        return self.fixed_foot.other

    def T_world_links(self, q: ArrayLike) -> Float:
        """T_world_link (..., 9, 4, 4) of LINKS for q (..., 8)."""
        T_footA_link = link_matrices(q)
        T_fixed_link = T_footA_link
        if self.fixed_foot is Foot.B:
            T_fixed_link = np.linalg.inv(T_footA_link[..., -1:, :, :] @ _T_FOOT_B) @ T_footA_link
        T: Float = self.T_world_foot.matrix @ T_fixed_link
        return T

    def T_world_free(self, q: ArrayLike) -> SE3:
        """The free foot's plate in the world, for q (8,)."""
        return self.T_world_foot @ T_fixed_free(q, self.fixed_foot)

    def free_matrices(self, q: ArrayLike) -> Float:
        """The same for many: (..., 4, 4) for q (..., 8)."""
        T_footA_footB = foot_matrices(q)
        T_fixed_free = T_footA_footB if self.fixed_foot is Foot.A else np.linalg.inv(T_footA_footB)
        T: Float = self.T_world_foot.matrix @ T_fixed_free
        return T

    def changed(self, q: ArrayLike) -> Stance:
        """The stance after the change of foot in posture q (8,): no link moves."""
        return Stance(self.free_foot, self.T_world_free(q))


_T_FOOT_B = HYRECRO.T_link_foot(Foot.B).matrix
