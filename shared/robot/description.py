"""What a URDF document says, as values: links, the tree of joints with their limits, the shapes that can be seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from shared.geometry import SE3

Vector3 = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Box:
    """Centred on its frame; edge lengths along x, y, z."""

    size_m: Vector3


@dataclass(frozen=True, slots=True)
class Cylinder:
    """Centred on its frame, along z."""

    radius_m: float
    length_m: float


@dataclass(frozen=True, slots=True)
class Sphere:
    """Centred on its frame."""

    radius_m: float


@dataclass(frozen=True, slots=True)
class Shape:
    """A visible solid that is rigidly part of a link."""

    link: str
    geometry: Box | Cylinder | Sphere
    T_link_shape: SE3


@dataclass(frozen=True, slots=True)
class Limits:
    """Of one joint: positions in radians or metres (infinite where continuous), velocity in either per second."""

    lower: float
    upper: float
    velocity: float


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
    """A URDF document as values. root: the link that is no joint's child; joints and shapes are in document order."""

    name: str
    root: str
    links: tuple[str, ...]
    joints: tuple[Joint, ...]
    shapes: tuple[Shape, ...]

    @property
    def limits(self) -> dict[str, Limits]:
        """Limits of the joints that move, by joint name."""
        return {joint.name: joint.limits for joint in self.joints if joint.limits is not None}
