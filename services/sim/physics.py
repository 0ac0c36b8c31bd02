"""The robot under gravity, among solid steel, with driven joints and feet that are held or let go (pybullet)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.sim.engine import ROOT_INDEX, Engine
from services.sim.quiet_pybullet import pybullet
from shared.geometry import SE3
from shared.messaging.messages import JOINT_NAMES, Foot
from shared.robot.description import UrdfModel
from shared.robot.kinematics import FOOT_LINKS, HYRECRO
from shared.runtime.config import DynamicsConfig
from shared.world.mesh_format import world_mesh
from shared.world.structure import Structure

_MAX_TRIANGLES = 40_000
"""A body of steel has at most so many: pybullet 3.2.7 takes 131,072 vertices a shape, found by trying."""
_HOLD_N = 1e6
"""What the engine may exert to keep a held foot in place: far above any magnet, whose limits are judged apart."""
_POSITION_GAIN, _VELOCITY_GAIN = 0.5, 1.0
"""Of pybullet's joint drives: share of the position error taken away in a step, and of the velocity error."""


class Physics:
    """Steps of fixed length, `step_s`. All members are one body of triangles: a step hardly grows with their number.

    Coordinates are the world's. A held foot does not touch: all load goes into its hold, which reports it as a wrench.
    """

    def __init__(
        self, urdf_text: str, model: UrdfModel, structure: Structure, config: DynamicsConfig, step_s: float
    ) -> None:
        self.engine = Engine(urdf_text, JOINT_NAMES, is_free=True)
        self._client, self._robot = self.engine.client, self.engine.robot
        self._efforts = [model.limits[name].effort for name in JOINT_NAMES]
        self._holds: dict[Foot, int] = {}
        self._loads: dict[Foot, list[tuple[float, ...]]] = {foot: [] for foot in Foot}
        self._T_mass_sole = {foot: self._sole_in_mass_frame(foot) for foot in Foot}
        self._steel = self._add_steel(structure)
        if structure.ground_z_m is not None:
            self._add_ground(structure.ground_z_m)
        pybullet.setGravity(0, 0, -config.gravity_mps2, **self._client)
        pybullet.setPhysicsEngineParameter(
            fixedTimeStep=step_s,
            numSolverIterations=config.num_solver_iterations,
            solverResidualThreshold=0,
            **self._client,
        )
        for index in range(ROOT_INDEX, pybullet.getNumJoints(self._robot, **self._client)):
            pybullet.changeDynamics(
                self._robot, index, linearDamping=0, angularDamping=0, jointDamping=0, **self._client
            )
        for foot in Foot:
            pybullet.changeDynamics(
                self._robot,
                self.engine.index(FOOT_LINKS[foot]),
                contactStiffness=config.sole_stiffness_n_per_m,
                contactDamping=config.sole_damping_ns_per_m,
                **self._client,
            )

    def drive(self, q: NDArray[np.float64], dq: NDArray[np.float64]) -> None:
        """Gives the drives their next setpoint (8,); they use at most the effort that the URDF allows."""
        pybullet.setJointMotorControlArray(
            self._robot,
            self.engine.joint_indices,
            pybullet.POSITION_CONTROL,
            targetPositions=q.tolist(),
            targetVelocities=dq.tolist(),
            forces=self._efforts,
            positionGains=[_POSITION_GAIN] * len(q),
            velocityGains=[_VELOCITY_GAIN] * len(q),
            **self._client,
        )

    def step(self) -> None:
        """Goes on by `step_s`."""
        pybullet.stepSimulation(**self._client)
        for foot, hold in self._holds.items():
            self._loads[foot].append(pybullet.getConstraintState(hold, **self._client))

    def joints(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Positions, velocities and the drives' efforts, (8,) each."""
        states = pybullet.getJointStates(self._robot, self.engine.joint_indices, **self._client)
        q, dq, _, effort = zip(*states, strict=True)
        return np.array(q), np.array(dq), np.array(effort)

    def T_world_foot(self, foot: Foot) -> SE3:
        """Where the centre of a foot's plate is."""
        return self.engine.T_world(FOOT_LINKS[foot]) @ HYRECRO.T_link_foot(foot)

    def hold(self, foot: Foot, T_world_foot: SE3) -> None:
        """Holds a foot there, or moves the hold there."""
        sole = T_world_foot @ HYRECRO.T_foot_sole
        place, turn = sole.translation.tolist(), sole.quat_xyzw.tolist()
        if foot in self._holds:
            pybullet.changeConstraint(self._holds[foot], place, turn, maxForce=_HOLD_N, **self._client)
            return
        index = self.engine.index(FOOT_LINKS[foot])
        in_foot = self._T_mass_sole[foot].translation.tolist()
        kind, nothing, axis, level = pybullet.JOINT_FIXED, -1, (0, 0, 0), (0, 0, 0, 1)
        hold = pybullet.createConstraint(
            self._robot, index, nothing, -1, kind, axis, in_foot, place, level, turn, **self._client
        )
        pybullet.changeConstraint(hold, maxForce=_HOLD_N, **self._client)
        self._holds[foot] = hold
        self._set_touching(foot, is_touching=False)

    def release(self, foot: Foot) -> None:
        """Lets a foot go; nothing where it is not held."""
        if foot in self._holds:
            pybullet.removeConstraint(self._holds.pop(foot), **self._client)
            self._loads[foot].clear()
            self._set_touching(foot, is_touching=True)

    def wrenches(self) -> dict[Foot, NDArray[np.float64]]:
        """What the hold exerted on each held foot (6,), as the mean over the steps since the last call.

        Force, then moment about the sole's centre, along the foot's axes. pybullet gives the force in the world's frame
        and the moment in that of the foot.
        """
        wrenches = {}
        for foot in self._holds:
            mean = np.mean(self._loads[foot], axis=0) if self._loads[foot] else np.zeros(6)
            R_world_foot = self.engine.T_world(FOOT_LINKS[foot]).rotation
            wrenches[foot] = np.concatenate([R_world_foot.T @ mean[:3], mean[3:]])
            self._loads[foot].clear()
        return wrenches

    def place(self, foot: Foot, T_world_foot: SE3, q: NDArray[np.float64] | None = None) -> None:
        """Puts the robot there at rest, its joints at q (8,), by default all at zero, no foot held."""
        for each in Foot:
            self.release(each)
        zero = np.zeros(len(JOINT_NAMES))
        T_world_link = T_world_foot @ HYRECRO.T_link_foot(foot).inv()
        self.engine.place(zero if q is None else q, zero, FOOT_LINKS[foot], T_world_link)
        pybullet.resetBaseVelocity(self._robot, (0, 0, 0), (0, 0, 0), **self._client)

    def _sole_in_mass_frame(self, foot: Foot) -> SE3:
        T_link_sole = HYRECRO.T_link_foot(foot) @ HYRECRO.T_foot_sole
        return self.engine.T_link_mass(FOOT_LINKS[foot]).inv() @ T_link_sole

    def _set_touching(self, foot: Foot, *, is_touching: bool) -> None:
        index = self.engine.index(FOOT_LINKS[foot])
        for body in self._steel:
            pybullet.setCollisionFilterPair(self._robot, body, index, -1, int(is_touching), **self._client)

    def _add_steel(self, structure: Structure) -> list[int]:
        mesh = world_mesh(structure)
        corners = mesh.vertices_m[mesh.triangles]
        starts = range(0, len(corners), _MAX_TRIANGLES)
        return [self._add_triangles(corners[start : start + _MAX_TRIANGLES]) for start in starts]

    def _add_triangles(self, corners: NDArray[np.floating]) -> int:
        """A body of triangles (T, 3, 3), which may be hollow, as it does not move."""
        shape = pybullet.createCollisionShape(
            pybullet.GEOM_MESH,
            vertices=corners.reshape(-1, 3).tolist(),
            indices=list(range(corners.size // 3)),
            flags=pybullet.GEOM_FORCE_CONCAVE_TRIMESH,
            **self._client,
        )
        body = int(pybullet.createMultiBody(0, shape, **self._client))
        pybullet.changeDynamics(body, -1, collisionMargin=0.0, **self._client)  # by default steel is 1 mm thicker
        return body

    def _add_ground(self, ground_z_m: float) -> None:
        plane = pybullet.createCollisionShape(pybullet.GEOM_PLANE, planeNormal=(0, 0, 1), **self._client)
        pybullet.createMultiBody(0, plane, basePosition=(0, 0, ground_z_m), **self._client)
