"""The simulated robot: one foot holds on to the structure, the joints move the rest of it."""

from __future__ import annotations

from collections import Counter
from typing import Any, TypeVar

import numpy as np

from services.sim.joint_targets import resolve_target
from services.sim.motion import JointMotion, plan_motion
from services.sim.poses import Poses, composed_poses, inverse_poses
from services.sim.world import World
from shared.errors import InputFileError
from shared.geometry import SE3
from shared.messaging.messages import (
    JOINT_NAMES,
    Clock,
    FixedFootDescription,
    JointState,
    JointTarget,
    LegState,
    LegTarget,
    Measurement,
    Message,
    RobotDescription,
    StructureDescription,
    Transforms,
)
from shared.robot.description import UrdfModel
from shared.robot.kinematics import FOOT_LINKS, HYRECRO
from shared.robot.urdf import parse_urdf
from shared.runtime.config import SimConfig
from shared.world.structure import Structure
from shared.world.urdf_format import structure_urdf

M = TypeVar("M", bound=Measurement)

WORLD_FRAME = "world"
FIXED_FOOT_FRAME = "fixed_foot"
"""Follows the plate of whichever foot is fixed."""

_CONTACT_DISTANCE_M = 1e-3
"""A foot this near to steel touches it: assumed, it leaves room for rounded trajectories."""


class ClimbingSim:
    """The facade: takes commands, and each `step` advances simulated time by 1 / `config.rate_hz`.

    However the joints move, the fixed foot stands still to 1e-9 m; changing the fixed foot moves no link at all.

    urdf_text: the robot. mark_text: the URDF of the mark that viewers draw at the fixed
    foot. source: where `urdf_text` comes from, for errors.

    Raises:
        InputFileError: the URDF is malformed, or not of this robot.
    """

    def __init__(
        self, config: SimConfig, urdf_text: str, structure: Structure, mark_text: str, source: str = "robot URDF"
    ) -> None:
        model = parse_urdf(urdf_text, source)
        _check_robot(model, source)
        by_name = {joint.name: joint for joint in model.joints}
        self._joints = [by_name[name] for name in JOINT_NAMES]
        self._max_velocity = np.array([model.limits[name].velocity for name in JOINT_NAMES])
        self._config = config
        self._urdf_text = urdf_text
        self._structure = structure
        self._world = World(urdf_text, JOINT_NAMES, structure)
        self._tree = _Tree(model, self._world.links)
        self._mark_text = mark_text
        self._fixed_foot = config.initial_foot
        T_world_foot = SE3.from_rpy(np.deg2rad(config.initial_foot_rpy_deg), config.initial_foot_xyz_m)
        self._T_world_held = T_world_foot @ HYRECRO.T_link_foot(self._fixed_foot).inv()
        self._motion = JointMotion(np.zeros(len(JOINT_NAMES)), np.zeros(len(JOINT_NAMES)))
        self._num_steps = self._stamp_ns = 0
        self._num_sent: Counter[type[Measurement]] = Counter()
        self._place()

    def start(self) -> list[Message]:
        """The descriptions and the first states, at time zero."""
        robot = self._stamped(RobotDescription, self._tree.root, urdf=self._urdf_text)
        mark = self._stamped(FixedFootDescription, FIXED_FOOT_FRAME, urdf=self._mark_text)
        structure = self._stamped(StructureDescription, WORLD_FRAME, urdf=structure_urdf(self._structure))
        return [robot, mark, structure, *self._states(), self._leg_state()]

    def step(self) -> list[Message]:
        """The states one step later."""
        num_leg_states = self._num_leg_states_due()
        self._num_steps += 1
        self._stamp_ns = round(self._num_steps * 1e9 / self._config.rate_hz)
        self._place()
        is_leg_state_due = self._num_leg_states_due() > num_leg_states
        return [*self._states(), self._leg_state()] if is_leg_state_due else self._states()

    def set_joint_target(self, target: JointTarget) -> list[Message]:
        """Sets the joints off towards a target, from where they are; the steps that follow carry it out.

        Raises:
            RefusedError: the target cannot be reached; the robot goes on with what it was doing.
        """
        q_end = resolve_target(target, self._joints, self._motion.q_end)
        q, _ = self._motion.at(self._stamp_ns)
        self._motion = plan_motion(q, q_end, self._stamp_ns, self._max_velocity, target.duration_s or 0.0)
        return []

    def set_fixed_foot(self, target: LegTarget) -> list[Message]:
        """Fixes the other foot where it is and frees the one that was fixed."""
        if target.foot is not self._fixed_foot:
            self._fixed_foot = target.foot
            self._T_world_held = self._world.T_world(FOOT_LINKS[target.foot])
        return [self._leg_state()]

    def close(self) -> None:
        """Ends the physics engine."""
        self._world.close()

    def _place(self) -> None:
        q, dq = self._motion.at(self._stamp_ns)
        self._world.place(q, dq, FOOT_LINKS[self._fixed_foot], self._T_world_held)

    def _states(self) -> list[Message]:
        q, dq = self._motion.at(self._stamp_ns)
        return [
            self._stamped(JointState, self._tree.root, q=q, dq=dq),
            self._stamped(
                Transforms,
                WORLD_FRAME,
                parents=(*self._tree.parents, WORLD_FRAME),
                children=(*self._tree.children, FIXED_FOOT_FRAME),
                T_parent_child=np.vstack([self._tree.edges(self._world.poses()), self._T_world_foot.xyz_quat_xyzw]),
            ),
            self._stamped(Clock, ""),
        ]

    @property
    def _T_world_foot(self) -> SE3:
        return self._T_world_held @ HYRECRO.T_link_foot(self._fixed_foot)

    def _leg_state(self) -> LegState:
        return self._stamped(
            LegState,
            WORLD_FRAME,
            fixed_foot=self._fixed_foot,
            T_world_foot=self._T_world_foot.xyz_quat_xyzw,
            has_contact=self._world.is_near_steel(FOOT_LINKS[self._fixed_foot], _CONTACT_DISTANCE_M),
        )

    def _num_leg_states_due(self) -> int:
        return int(self._num_steps * self._config.leg_state_rate_hz / self._config.rate_hz)

    def _stamped(self, kind: type[M], frame: str, **fields: Any) -> M:
        seq = self._num_sent[kind]
        self._num_sent[kind] += 1
        return kind(stamp_ns=self._stamp_ns, seq=seq, frame=frame, **fields)


class _Tree:
    """The frame tree: world -> root link, then each joint's parent -> child."""

    def __init__(self, model: UrdfModel, links: tuple[str, ...]) -> None:
        self.root = model.root
        self.parents = (WORLD_FRAME, *(joint.parent for joint in model.joints))
        self.children = (model.root, *(joint.child for joint in model.joints))
        self._parent_rows = [links.index(name) for name in self.parents[1:]]
        self._child_rows = [links.index(name) for name in self.children[1:]]

    def edges(self, T_world_link: Poses) -> Poses:
        """T_parent_child (E, 7) of each edge from T_world_link (L, 7) of each link, the root first."""
        T_parent_world = inverse_poses(T_world_link[self._parent_rows])
        return np.vstack([T_world_link[0], composed_poses(T_parent_world, T_world_link[self._child_rows])])


def _check_robot(model: UrdfModel, source: str) -> None:
    for what, has, needs in (("joints", model.limits, JOINT_NAMES), ("links", model.links, FOOT_LINKS.values())):
        if missing := [name for name in needs if name not in has]:
            raise InputFileError(f"{source}: {what} {', '.join(missing)} are missing; it has {', '.join(has)}")
    if extra := [name for name in model.limits if name not in JOINT_NAMES]:
        raise InputFileError(f"{source}: unknown joints {', '.join(extra)}; only {', '.join(JOINT_NAMES)} may move")
