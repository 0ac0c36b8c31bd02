"""A robot with masses, driven joints and magnetic feet, which can slip off and fall."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.sim.body import FootState, Joints, pull_n
from services.sim.magnet import Magnet
from services.sim.motion import JointMotion
from services.sim.physics import Physics
from services.sim.setpoint import Setpoint
from services.sim.slip import Slip
from services.sim.state import BodyState
from shared.climbing.steel import SteelSurface
from shared.geometry import SE3
from shared.messaging.messages import JOINT_NAMES, Foot
from shared.robot.description import UrdfModel
from shared.runtime.config import SimConfig
from shared.world.structure import Structure

_SETTLE_S = 0.1
"""How long a magnet takes to draw its foot flush once the other foot has let go: assumed."""


class DynamicBody:
    """Fulfils `Body`. A foot takes hold within a gap and an angle of steel; it lets go beyond what its magnet can bear.

    At a change of foot both hold for `config.magnets.overlap_s`; then the old one lets go and the new one is drawn
    flush. If the new foot finds no steel, the old one lets go all the same, and the robot falls.

    T_world_foot: where the plate of `config.initial_foot` stands at the start.
    """

    def __init__(
        self,
        urdf_text: str,
        model: UrdfModel,
        structure: Structure,
        config: SimConfig,
        T_world_foot: SE3,
        slip: Slip,
    ) -> None:
        dynamics = config.dynamics
        self._num_steps = max(1, round(dynamics.step_hz / config.rate_hz))
        self._step_s = 1.0 / (config.rate_hz * self._num_steps)  # so that a period is a whole number of steps
        self._physics = Physics(urdf_text, model, structure, dynamics, self._step_s)
        self._steel = SteelSurface(structure)
        self._initial = (config.initial_foot, T_world_foot)
        self._overlap_ns = round(config.magnets.overlap_s * 1e9)
        self._num_settle_steps = max(1, round(_SETTLE_S / self._step_s))
        max_velocity = np.array([model.limits[name].velocity for name in JOINT_NAMES])
        self._setpoint = Setpoint(max_velocity, max_velocity / dynamics.ramp_s, dynamics.bandwidth_hz)
        self._magnets = {foot: Magnet(foot, config.magnets) for foot in Foot}
        self._slip = slip
        self.links = self._physics.engine.links
        self.effort: Joints | None = None
        self._fixed_foot: Foot
        self._wrenches: dict[Foot, NDArray[np.float64]]
        self._hold_poses: dict[Foot, SE3]
        self._path: list[SE3]
        self._release_ns: int | None
        self._news: list[str]
        self.reset()

    def reset(self) -> None:
        """Back to the initial place, all joints at zero, the initial foot holding if there is steel below it."""
        self._place(*self._initial, np.zeros(len(JOINT_NAMES)))
        self._news = self._take_hold(self._fixed_foot, SE3.identity())
        self._read_joints()

    def snapshot(self) -> BodyState:
        """Where the feet are held, or the fixed one is, and the joints."""
        held = self._hold_poses
        T_world_foot = held.get(self._fixed_foot) or self.T_world_foot
        return BodyState(
            q=self.q,
            fixed_foot=self._fixed_foot,
            T_world_foot=T_world_foot.matrix,
            holding=tuple(held),
            T_world_held=np.array([pose.matrix for pose in held.values()]).reshape(-1, 4, 4),
            is_changing=self._release_ns is not None,
        )

    def restore(self, state: BodyState, stamp_ns: int) -> None:
        """Stands there at rest, held as before; a change of foot that was under way goes on, a fall begins anew."""
        self._place(state.fixed_foot, SE3.from_matrix(state.T_world_foot), state.q)
        for foot, pose in zip(state.holding, state.T_world_held, strict=True):
            self._hold(foot, SE3.from_matrix(pose))
        self._T_foot_slipped = SE3.identity()
        if state.is_changing:
            self._release_ns = stamp_ns + self._overlap_ns
        elif self._fixed_foot in self._hold_poses:
            self._draw_flush(self._fixed_foot)
        self._news = []
        self._read_joints()

    def resting_q(self) -> Joints:
        """A braking distance on, at the drives' acceleration."""
        return self.q + self._setpoint.braking_distance(self.dq)

    def advance(self, motion: JointMotion, from_ns: int, to_ns: int) -> list[str]:
        """Goes on in steps of the engine; magnets are judged by the mean load of the whole period."""
        for step in range(1, self._num_steps + 1):
            stamp_ns = from_ns + (to_ns - from_ns) * step // self._num_steps
            self._setpoint.follow(*motion.at(stamp_ns), self._step_s)
            self._physics.drive(self._setpoint.q, self._setpoint.dq)
            self._settle()
            self._physics.step()
        self._wrenches = self._physics.wrenches()
        self._read_joints()
        news, self._news = self._news, []
        return news + self._judge_loads() + self._end_overlap(to_ns)

    def change_foot(self, foot: Foot, stamp_ns: int) -> list[str]:
        """The foot takes hold, if it can; the other lets go, at once or when the overlap is over."""
        if foot is self._fixed_foot and foot in self._hold_poses:
            self._release_ns = None
            self._release(foot.other)  # a change that was under way is called off
            return []
        news = [] if foot in self._hold_poses else self._take_hold(foot, self._slip.next())
        if foot in self._hold_poses and foot.other in self._hold_poses:
            self._release_ns = stamp_ns + self._overlap_ns
            return news
        self._fixed_foot = foot
        if foot.other in self._hold_poses:
            news += self._let_go(foot.other, f"foot {foot.other.value} is released")
        return news

    @property
    def T_world_foot(self) -> SE3:
        """Where the plate of the fixed foot is."""
        return self._physics.T_world_foot(self._fixed_foot)

    def foot_state(self) -> FootState:
        """The fixed foot's hold and load."""
        foot = self._fixed_foot
        T_world_foot = self.T_world_foot
        magnet, contact = self._magnets[foot], self._steel.under_sole(T_world_foot)
        wrench = self._wrenches.get(foot)
        return FootState(
            fixed_foot=foot,
            T_world_foot=T_world_foot,
            has_contact=magnet.can_hold(contact),
            holding=tuple(each for each in Foot if each in self._hold_poses),
            wrench=wrench,
            load_n=None if wrench is None else pull_n(wrench),
            margin=None if wrench is None else magnet.margin(wrench),
        )

    def poses(self) -> NDArray[np.float64]:
        """T_world_link (L, 7) of every link."""
        return self._physics.engine.poses()

    def close(self) -> None:
        """Ends the engine."""
        self._physics.engine.close()

    def _place(self, foot: Foot, T_world_foot: SE3, q: Joints) -> None:
        """At rest, nothing held."""
        self._fixed_foot = foot
        self._physics.place(foot, T_world_foot, q)
        self._setpoint.reset(q)
        self._wrenches, self._hold_poses, self._path, self._release_ns = {}, {}, [], None

    def _take_hold(self, foot: Foot, T_foot_slipped: SE3) -> list[str]:
        T_world_foot = self._physics.T_world_foot(foot)
        contact = self._steel.under_sole(T_world_foot)
        magnet = self._magnets[foot]
        if not magnet.can_hold(contact):
            return [magnet.no_hold_text(contact)]
        self._hold(foot, T_world_foot)
        self._T_foot_slipped = T_foot_slipped
        if foot.other not in self._hold_poses:
            self._draw_flush(foot)
        return []

    def _hold(self, foot: Foot, T_world_foot: SE3) -> None:
        self._hold_poses[foot] = T_world_foot
        self._physics.hold(foot, T_world_foot)

    def _draw_flush(self, foot: Foot) -> None:
        """Plans how the hold moves from where the foot took it to flush on the steel, and as far as it slips there."""
        start = self._hold_poses[foot]
        goal = (self._steel.flush_pose(start) or start) @ self._T_foot_slipped
        way = (start.inv() @ goal).log()
        shares = np.linspace(0, 1, self._num_settle_steps + 1)[1:]
        self._path = [start @ SE3.exp(share * way) for share in shares] if np.abs(way).max() > 1e-12 else []

    def _settle(self) -> None:
        if self._path and self._fixed_foot in self._hold_poses:
            self._hold(self._fixed_foot, self._path.pop(0))

    def _judge_loads(self) -> list[str]:
        overloads = {foot: self._magnets[foot].overload(wrench) for foot, wrench in self._wrenches.items()}
        return [text for foot, reason in overloads.items() if reason for text in self._let_go(foot, reason)]

    def _end_overlap(self, stamp_ns: int) -> list[str]:
        if self._release_ns is None or stamp_ns < self._release_ns:
            return []
        new = self._fixed_foot.other
        self._release_ns = None
        if new not in self._hold_poses:
            return []  # it let go under its load while both held
        self._fixed_foot = new
        self._release(new.other)
        self._draw_flush(new)
        return []

    def _let_go(self, foot: Foot, reason: str) -> list[str]:
        self._release(foot)
        if foot.other in self._hold_poses:
            self._fixed_foot = foot.other
            return [reason]
        return [f"{reason}; nothing holds the robot, it falls"]

    def _release(self, foot: Foot) -> None:
        if foot in self._hold_poses:
            self._physics.release(foot)
            del self._hold_poses[foot]
            self._wrenches.pop(foot, None)
            self._path = []

    def _read_joints(self) -> None:
        self.q, self.dq, self.effort = self._physics.joints()
