"""A robot that cannot fall: the fixed foot stands still, the joints are where they are commanded."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.sim.body import FootState, Joints, pull_n
from services.sim.engine import Engine
from services.sim.magnet import Magnet
from services.sim.motion import JointMotion
from services.sim.slip import Slip
from services.sim.state import BodyState
from shared.climbing.holding import Holding
from shared.climbing.steel import SteelSurface
from shared.geometry import SE3
from shared.messaging.messages import JOINT_NAMES, Foot
from shared.robot.description import UrdfModel
from shared.robot.kinematics import FOOT_LINKS, HYRECRO
from shared.robot.statics import holding_wrench
from shared.runtime.config import SimConfig

_MAX_GAP_M, _MAX_ANGLE_RAD = 1e-3, np.deg2rad(1.0)
"""A sole this near to steel touches it: assumed, it leaves room for rounded trajectories."""


class KinematicBody:
    """Fulfils `Body`. The fixed foot does not move, and changing it moves no link, unless it slips.

    It bears what statics says, and nothing comes of it if that is too much.

    T_world_foot: where the plate of `config.initial_foot` stands at the start.

    Raises:
        InputFileError: pybullet cannot load the URDF, or a mass in it belongs to no link of the robot.
    """

    def __init__(
        self, urdf_text: str, model: UrdfModel, steel: SteelSurface, config: SimConfig, T_world_foot: SE3, slip: Slip
    ) -> None:
        self._engine = Engine(urdf_text, JOINT_NAMES)
        self._steel = steel
        self._masses = Holding.of(model).masses
        self._gravity_mps2 = config.dynamics.gravity_mps2
        self._magnets = {foot: Magnet(foot, config.magnets) for foot in Foot}
        self._initial = (config.initial_foot, T_world_foot)
        self._slip = slip
        self.links = self._engine.links
        self.effort: Joints | None = None
        self.reset()

    def reset(self) -> None:
        """Back to the initial place, all joints at zero."""
        self._fixed_foot, T_world_foot = self._initial
        self._T_world_held = T_world_foot @ HYRECRO.T_link_foot(self._fixed_foot).inv()
        self.q = self.dq = np.zeros(len(JOINT_NAMES))
        self._place()

    def resting_q(self) -> Joints:
        """Where they are: nothing has mass."""
        return self.q

    def advance(self, motion: JointMotion, _from_ns: int, to_ns: int) -> list[str]:
        """Places the joints where the motion has them at `to_ns`."""
        self.q, self.dq = motion.at(to_ns)
        self._place()
        return []

    def change_foot(self, foot: Foot, _stamp_ns: int) -> list[str]:
        """Fixes the other foot where it is and frees the one that was fixed."""
        if foot is not self._fixed_foot:
            self._fixed_foot = foot
            T_world_foot = self._engine.T_world(FOOT_LINKS[foot]) @ HYRECRO.T_link_foot(foot)
            self._T_world_held = T_world_foot @ self._slip.next() @ HYRECRO.T_link_foot(foot).inv()
        return []

    @property
    def T_world_foot(self) -> SE3:
        """Where the plate of the fixed foot is."""
        return self._T_world_held @ HYRECRO.T_link_foot(self._fixed_foot)

    def foot_state(self) -> FootState:
        """The fixed foot holds, whatever it stands on and bears."""
        foot, T_world_foot = self._fixed_foot, self.T_world_foot
        contact = self._steel.under_sole(T_world_foot)
        wrench = holding_wrench(self.q, foot, T_world_foot.rotation, self._masses, self._gravity_mps2)
        return FootState(
            fixed_foot=foot,
            T_world_foot=T_world_foot,
            has_contact=contact.is_flush(_MAX_GAP_M, _MAX_ANGLE_RAD),
            holding=(foot,),
            wrench=wrench,
            load_n=pull_n(wrench),
            margin=self._magnets[foot].margin(wrench),
        )

    def poses(self) -> NDArray[np.float64]:
        """T_world_link (L, 7) of every link."""
        return self._engine.poses()

    def snapshot(self) -> BodyState:
        """Where the fixed foot is, and the joints."""
        T_world_foot = self.T_world_foot.matrix
        return BodyState(
            q=self.q,
            fixed_foot=self._fixed_foot,
            T_world_foot=T_world_foot,
            holding=(self._fixed_foot,),
            T_world_held=T_world_foot[np.newaxis],
            is_changing=False,
        )

    def restore(self, state: BodyState, _stamp_ns: int) -> None:
        """Stands there, to 1e-9 m."""
        self._fixed_foot = state.fixed_foot
        T_world_foot = SE3.from_matrix(state.T_world_foot)
        self._T_world_held = T_world_foot @ HYRECRO.T_link_foot(self._fixed_foot).inv()
        self.q, self.dq = state.q, np.zeros(len(JOINT_NAMES))
        self._place()

    def close(self) -> None:
        """Ends the engine."""
        self._engine.close()

    def _place(self) -> None:
        self._engine.place(self.q, self.dq, FOOT_LINKS[self._fixed_foot], self._T_world_held)
