"""What a URDF document says, as values: links, the tree of joints with their limits, the shapes that can be seen."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from shared.geometry import SE3
from shared.solids import Solid, Vector3


@dataclass(frozen=True, slots=True)
class Shape:
    """A solid that is rigidly part of a link. material: by name; empty where the document states none."""

    link: str
    solid: Solid
    T_link_shape: SE3
    name: str = ""
    material: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Inertia:
    """Of one link: mass at `T_link_mass`, moments of inertia (3, 3) in kg m^2 about and along that frame's axes."""

    mass_kg: float
    T_link_mass: SE3
    moments: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Limits:
    """Of one joint: positions in radians or metres (infinite where continuous), velocity in either per second.

    effort: Nm or N, infinite where the document states none.
    """

    lower: float
    upper: float
    velocity: float
    effort: float = math.inf


@dataclass(frozen=True, slots=True)
class Joint:
    """An edge of the tree. kind: revolute, continuous, prismatic or fixed; axis: unit vector; fixed has no limits."""

    name: str
    kind: str
    parent: str
    child: str
    T_parent_joint: SE3
    axis: Vector3
    limits: Limits | None

    def T_parent_child(self, position: float = 0.0) -> SE3:
        """T_parent_child at a joint position in radians or metres."""
        motion = position * np.array(self.axis)
        if self.kind == "fixed":
            return self.T_parent_joint
        if self.kind == "prismatic":
            return self.T_parent_joint @ SE3(np.eye(3), motion)
        return self.T_parent_joint @ SE3.exp(np.concatenate([np.zeros(3), motion]))


@dataclass(frozen=True, slots=True)
class UrdfModel:
    """A URDF document as values. root: the link that is no joint's child; joints and shapes are in document order.

    shapes: what can be seen. collisions: what bodies touch with. inertias: of the links that state one.
    """

    name: str
    root: str
    links: tuple[str, ...]
    joints: tuple[Joint, ...]
    shapes: tuple[Shape, ...]
    collisions: tuple[Shape, ...] = ()
    inertias: Mapping[str, Inertia] = field(default_factory=dict)

    @property
    def limits(self) -> dict[str, Limits]:
        """Limits of the joints that move, by joint name."""
        return {joint.name: joint.limits for joint in self.joints if joint.limits is not None}
