"""The robot's bodies: what its links touch with, as convex solids that move with the kinematic chain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared.climbing.convex import Zonotopes, stacked, zonotope
from shared.errors import InputFileError
from shared.geometry import SE3, Float
from shared.robot.description import UrdfModel
from shared.robot.kinematics import LINKS
from shared.solids import Mesh


@dataclass(frozen=True, slots=True, eq=False)
class Bodies:
    """Bodies of one kind: names (K,) of their links, chain (K,) the index in LINKS of the link each is rigid with.

    solids (K) are in the frames of those links of the chain.
    """

    names: tuple[str, ...]
    chain: NDArray[np.int64]
    solids: Zonotopes

    def placed(self, T_world_links: Float) -> Zonotopes:
        """In the world, (S, K), for T_world_link (S, 9, 4, 4)."""
        return self.solids.moved(T_world_links[:, self.chain])

    def corners_m(self) -> Float:
        """(K, 8, 3) corners of the boxes round the bodies, along the axes of their links."""
        signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        corners: Float = self.solids.centres[:, None] + signs * self.solids.reach()[:, None]
        return corners


def bodies_of(model: UrdfModel) -> tuple[Bodies, ...]:
    """What the <collision> elements say, grouped by kind of solid.

    Raises:
        InputFileError: a shape is a mesh, or its link is not rigid with one of LINKS.
    """
    mounts = _mounts(model)
    kinds: dict[int, list[tuple[str, int, Zonotopes]]] = {}
    for shape in model.collisions:
        if shape.link not in mounts or isinstance(shape.solid, Mesh):
            raise InputFileError(
                f"robot '{model.name}': collision of link '{shape.link}': must be a box, cylinder or sphere that is "
                f"rigid with one of {', '.join(LINKS)}"
            )
        chain, T_chain_link = mounts[shape.link]
        solid = zonotope(shape.solid).moved((T_chain_link @ shape.T_link_shape).matrix)
        kinds.setdefault(solid.generators.shape[-2], []).append((shape.link, chain, solid))
    return tuple(_stacked(kind) for kind in kinds.values())


def _stacked(entries: list[tuple[str, int, Zonotopes]]) -> Bodies:
    names, chain, solids = zip(*entries, strict=True)
    return Bodies(names, np.array(chain), stacked(solids))


def _mounts(model: UrdfModel) -> dict[str, tuple[int, SE3]]:
    """Of each link that is rigid with one of LINKS: that one's index, and T_chain_link."""
    mounts = {name: (i, SE3.identity()) for i, name in enumerate(LINKS)}
    for _ in model.joints:  # as many rounds as a chain of fixed joints can be long
        for joint in model.joints:
            if joint.kind == "fixed" and joint.parent in mounts and joint.child not in mounts:
                chain, T = mounts[joint.parent]
                mounts[joint.child] = (chain, T @ joint.T_parent_joint)
    return mounts
