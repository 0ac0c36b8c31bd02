"""Finding what rays meet first: the interface of the backends, and what they take and give."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from services.sensors.depth.pinhole import Pinhole
from services.sensors.lidar.beams import Beams
from services.sensors.lidar.footprint import Footprint
from services.sensors.scene import Scene

NO_FACE = -1


@dataclass(frozen=True, slots=True, eq=False)
class Hits:
    """What each ray met first: arrays (C, R) of a scan's columns and rings, or (H, W) of an image.

    range_m: along the ray from where the ray's origin is; of an image, the depth along the optical axis; inf where
    nothing was met. face: its number in the scene, NO_FACE where none. cos_incidence: of the angle between ray and
    surface normal, 0 where nothing was met.
    """

    range_m: NDArray[np.float32]
    face: NDArray[np.int32]
    cos_incidence: NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Poses:
    """Where the sensor and the scene's links are in the world while the rays are cast.

    sensor_rotation (N, 3, 3), sensor_translation_m (N, 3): N is 1 for a still sensor, or one a column of a scan.
    link_rotation (B, L, 3, 3), link_translation_m (B, L, 3): of the scene's L links in B blocks of columns; column c
    of C is in block c * B // C.
    """

    sensor_rotation: NDArray[np.float64]
    sensor_translation_m: NDArray[np.float64]
    link_rotation: NDArray[np.float64]
    link_translation_m: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class EdgeHits:
    """What the sub-rays (see `lidar.footprint`) met of those beams whose sub-rays do not all meet one surface.

    A convex shape is one surface: where two of its faces join, ranges do not jump. Of other shapes all faces in a plane
    are one.

    cells (E,): index into the flattened (C, R) of `Hits`, increasing. range_m, face, cos_incidence (E, K): of each
    sub-ray, as in `Hits`; the distance is along the sub-ray, from the plane across the beam's origin.
    """

    cells: NDArray[np.int64]
    range_m: NDArray[np.float32]
    face: NDArray[np.int32]
    cos_incidence: NDArray[np.float32]


class RayBackend(Protocol):
    """Meets rays with a scene, which seldom changes, at poses which change each time."""

    def set_scene(self, scene: Scene) -> None:
        """Takes what the rays can meet."""

    def scan(self, beams: Beams, poses: Poses, near_m: float, far_m: float) -> Hits:
        """The first hits between `near_m` and `far_m` along each beam."""

    def edges(self, beams: Beams, poses: Poses, near_m: float, far_m: float, footprint: Footprint) -> EdgeHits:
        """The sub-rays of the beams that the last `scan` cast, with the same arguments, where an edge is near."""

    def image(self, camera: Pinhole, poses: Poses, near_m: float, far_m: float) -> Hits:
        """The first hits between the depths `near_m` and `far_m` through each pixel; valid until the next call."""
