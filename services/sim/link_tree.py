"""The robot's frames as a tree: the world, the root link, then each joint's parent and child."""

from __future__ import annotations

import numpy as np

from services.sim.poses import Poses, composed_poses, inverse_poses
from shared.robot.description import UrdfModel

WORLD_FRAME = "world"
FIXED_FOOT_FRAME = "fixed_foot"
"""Follows the plate of whichever foot is fixed."""


class LinkTree:
    """Parents and children of the tree's edges, and their transforms. links: the order in which poses come."""

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
