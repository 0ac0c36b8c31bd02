"""The robot and the structure in a physics engine of their own (pybullet), moved kinematically."""

from __future__ import annotations

import tempfile
from typing import Any

import numpy as np
from numpy.typing import NDArray

from services.sim.poses import composed_poses, inverse_poses
from services.sim.quiet_pybullet import pybullet
from shared.errors import InputFileError
from shared.geometry import SE3
from shared.solids import Box, Cylinder, Mesh
from shared.world.structure import Member, Structure

_ROOT_INDEX = -1
"""By which pybullet calls a body's root link; its other links are numbered from 0."""

_MAX_MESH_VERTICES, _MAX_MESH_TRIANGLES = 131_072, 524_288 // 3
"""Found by trying, pybullet 3.2.7: it refuses more with an error that says nothing."""


class World:
    """One robot and one structure; the robot's root is placed such that a chosen link stands where it shall.

    joint_names: the order of positions and velocities. links: names in the order of `poses`, the root first.

    Raises:
        InputFileError: pybullet cannot load the URDF.
    """

    def __init__(self, urdf_text: str, joint_names: tuple[str, ...], structure: Structure) -> None:
        self._client: dict[str, int] = {"physicsClientId": pybullet.connect(pybullet.DIRECT)}
        self._robot = self._load_robot(urdf_text)
        self._bars = [self._add_bar(member) for member in structure.members]
        num_joints = pybullet.getNumJoints(self._robot, **self._client)
        infos = [pybullet.getJointInfo(self._robot, i, **self._client) for i in range(num_joints)]
        indices = {info[1].decode(): info[0] for info in infos}
        root = pybullet.getBodyInfo(self._robot, **self._client)[0].decode()
        self.links: tuple[str, ...] = (root, *(info[12].decode() for info in infos))
        self._joint_indices = [indices[name] for name in joint_names]
        self._link_indices = list(range(num_joints))
        self._T_link_mass = np.array([self._mass_frame(i) for i in (_ROOT_INDEX, *self._link_indices)])
        self._T_mass_link = inverse_poses(self._T_link_mass)

    def close(self) -> None:
        """Disconnects from the engine; nothing else may be called afterwards."""
        pybullet.disconnect(**self._client)

    def place(self, q: NDArray[np.float64], dq: NDArray[np.float64], link: str, T_world_link: SE3) -> None:
        """Sets joint positions and velocities (J,), and the root such that `link` stands at `T_world_link`."""
        positions, velocities = q[:, np.newaxis].tolist(), dq[:, np.newaxis].tolist()
        pybullet.resetJointStatesMultiDof(self._robot, self._joint_indices, positions, velocities, **self._client)
        poses = self.poses()
        root, held = (SE3.from_xyz_quat_xyzw(poses[row]) for row in (0, self.links.index(link)))
        T_world_root = T_world_link @ held.inv() @ root
        pose = (T_world_root @ SE3.from_xyz_quat_xyzw(self._T_link_mass[0])).xyz_quat_xyzw.tolist()
        pybullet.resetBasePositionAndOrientation(self._robot, pose[:3], pose[3:], **self._client)

    def poses(self) -> NDArray[np.float64]:
        """T_world_link of every link as (L, 7) x y z in metres and quaternion x y z w, in the order of `links`.

        pybullet rounds link frames to float32 on the way out, 1e-6 m here; the frames of the masses come in float64.
        """
        states = pybullet.getLinkStates(self._robot, self._link_indices, computeForwardKinematics=True, **self._client)
        root = pybullet.getBasePositionAndOrientation(self._robot, **self._client)
        T_world_mass = np.array([root[0] + root[1], *(state[0] + state[1] for state in states)])
        return composed_poses(T_world_mass, self._T_mass_link)

    def T_world(self, link: str) -> SE3:
        """Where a link's frame stands in the world."""
        return SE3.from_xyz_quat_xyzw(self.poses()[self.links.index(link)])

    def is_near_steel(self, link: str, distance_m: float) -> bool:
        """Whether the collision shape of a link comes within a distance of any bar."""
        index = self.links.index(link) + _ROOT_INDEX
        return any(
            pybullet.getClosestPoints(self._robot, bar, distance_m, linkIndexA=index, **self._client)
            for bar in self._bars
        )

    def _mass_frame(self, index: int) -> tuple[float, ...]:
        """T_link_mass of one link, (7,)."""
        info = pybullet.getDynamicsInfo(self._robot, index, **self._client)
        return tuple(info[3] + info[4])

    def _load_robot(self, urdf_text: str) -> int:
        with tempfile.NamedTemporaryFile("w", suffix=".urdf", encoding="utf-8") as file:
            file.write(urdf_text)
            file.flush()
            try:
                return int(pybullet.loadURDF(file.name, useFixedBase=True, **self._client))
            except pybullet.error as error:
                self.close()
                raise InputFileError(f"robot URDF: pybullet cannot load it: {error}") from error

    def _add_bar(self, bar: Member) -> int:
        pose = bar.T_world_member.xyz_quat_xyzw.tolist()
        if isinstance(bar.solid, Mesh):
            num_vertices, num_triangles = len(bar.solid.vertices_m), len(bar.solid.triangles)
            if num_vertices > _MAX_MESH_VERTICES or num_triangles > _MAX_MESH_TRIANGLES:
                self.close()
                raise InputFileError(
                    f"structure: member '{bar.name}': {num_vertices} vertices and {num_triangles} triangles; pybullet "
                    f"takes at most {_MAX_MESH_VERTICES} and {_MAX_MESH_TRIANGLES} a mesh: split it or make it coarser"
                )
        shape = pybullet.createCollisionShape(**_collision_shape(bar.solid), **self._client)
        return int(
            pybullet.createMultiBody(
                baseCollisionShapeIndex=shape, basePosition=pose[:3], baseOrientation=pose[3:], **self._client
            )
        )


def _collision_shape(solid: Box | Cylinder | Mesh) -> dict[str, Any]:
    """A solid in pybullet's words; a mesh keeps its hollows, which it may as it does not move."""
    match solid:
        case Box(size_m):
            return {"shapeType": pybullet.GEOM_BOX, "halfExtents": [length / 2 for length in size_m]}
        case Cylinder(radius_m, length_m):
            return {"shapeType": pybullet.GEOM_CYLINDER, "radius": radius_m, "height": length_m}
        case Mesh(vertices_m, triangles):
            return {
                "shapeType": pybullet.GEOM_MESH,
                "vertices": vertices_m.tolist(),
                "indices": triangles.ravel().tolist(),
                "flags": pybullet.GEOM_FORCE_CONCAVE_TRIMESH,
            }
