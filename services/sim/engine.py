"""The robot in a physics engine of its own (pybullet): where its links are, and putting them there."""

from __future__ import annotations

import tempfile
from typing import Any

import numpy as np
from numpy.typing import NDArray

from services.sim.poses import composed_poses, inverse_poses
from services.sim.quiet_pybullet import pybullet
from shared.errors import InputFileError
from shared.geometry import SE3

ROOT_INDEX = -1
"""By which pybullet calls a body's root link; its other links are numbered from 0."""


class Engine:
    """One robot; its root is placed such that a chosen link stands where it shall.

    joint_names: the order of positions and velocities. is_free: whether physics may move the root. links: names in the
    order of `poses`, the root first. client, robot, joint_indices: for those who call pybullet themselves.

    Raises:
        InputFileError: pybullet cannot load the URDF.
    """

    def __init__(self, urdf_text: str, joint_names: tuple[str, ...], *, is_free: bool = False) -> None:
        self.client: dict[str, int] = {"physicsClientId": pybullet.connect(pybullet.DIRECT)}
        self.robot = self._load_robot(urdf_text, is_free)
        num_joints = pybullet.getNumJoints(self.robot, **self.client)
        infos = [pybullet.getJointInfo(self.robot, i, **self.client) for i in range(num_joints)]
        indices = {info[1].decode(): info[0] for info in infos}
        root = pybullet.getBodyInfo(self.robot, **self.client)[0].decode()
        self.links: tuple[str, ...] = (root, *(info[12].decode() for info in infos))
        self.joint_indices = [indices[name] for name in joint_names]
        self._link_indices = list(range(num_joints))
        self._T_link_mass = np.array([self._mass_frame(i) for i in (ROOT_INDEX, *self._link_indices)])
        self._T_mass_link = inverse_poses(self._T_link_mass)

    def close(self) -> None:
        """Disconnects from the engine; nothing else may be called afterwards."""
        pybullet.disconnect(**self.client)

    def place(self, q: NDArray[np.float64], dq: NDArray[np.float64], link: str, T_world_link: SE3) -> None:
        """Sets joint positions and velocities (J,), and the root such that `link` stands at `T_world_link`."""
        positions, velocities = q[:, np.newaxis].tolist(), dq[:, np.newaxis].tolist()
        pybullet.resetJointStatesMultiDof(self.robot, self.joint_indices, positions, velocities, **self.client)
        poses = self.poses()
        root, held = (SE3.from_xyz_quat_xyzw(poses[row]) for row in (0, self.links.index(link)))
        T_world_root = T_world_link @ held.inv() @ root
        pose = (T_world_root @ self.T_link_mass(self.links[0])).xyz_quat_xyzw.tolist()
        pybullet.resetBasePositionAndOrientation(self.robot, pose[:3], pose[3:], **self.client)

    def poses(self) -> NDArray[np.float64]:
        """T_world_link of every link as (L, 7) x y z in metres and quaternion x y z w, in the order of `links`.

        pybullet rounds link frames to float32 on the way out, 1e-6 m here; the frames of the masses come in float64.
        """
        states = pybullet.getLinkStates(self.robot, self._link_indices, computeForwardKinematics=True, **self.client)
        root = pybullet.getBasePositionAndOrientation(self.robot, **self.client)
        T_world_mass = np.array([root[0] + root[1], *(state[0] + state[1] for state in states)])
        return composed_poses(T_world_mass, self._T_mass_link)

    def T_world(self, link: str) -> SE3:
        """Where a link's frame stands in the world."""
        return SE3.from_xyz_quat_xyzw(self.poses()[self.links.index(link)])

    def T_link_mass(self, link: str) -> SE3:
        """Where the frame of a link's mass is, to which pybullet refers all its positions."""
        return SE3.from_xyz_quat_xyzw(self._T_link_mass[self.links.index(link)])

    def index(self, link: str) -> int:
        """pybullet's number of a link."""
        return self.links.index(link) + ROOT_INDEX

    def _mass_frame(self, index: int) -> tuple[float, ...]:
        """T_link_mass of one link, (7,)."""
        info: Any = pybullet.getDynamicsInfo(self.robot, index, **self.client)
        return tuple(info[3] + info[4])

    def _load_robot(self, urdf_text: str, is_free: bool) -> int:
        with tempfile.NamedTemporaryFile("w", suffix=".urdf", encoding="utf-8") as file:
            file.write(urdf_text)
            file.flush()
            try:
                return int(pybullet.loadURDF(file.name, useFixedBase=not is_free, **self.client))
            except pybullet.error as error:
                self.close()
                raise InputFileError(f"robot URDF: pybullet cannot load it: {error}") from error
