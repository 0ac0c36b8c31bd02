"""Rigid solids that bodies are made of, each in a frame of its own: boxes, cylinders, spheres, closed meshes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

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


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Triangles (T, 3) of indices into vertices (V, 3) in metres, wound counter-clockwise seen from outside.

    file: where it was read from, None if it was made; scale: what the file's coordinates were multiplied by.
    """

    vertices_m: NDArray[np.floating]
    triangles: NDArray[np.uint32]
    file: Path | None = None
    scale: Vector3 = (1.0, 1.0, 1.0)

    def moved(self, T_a_b: SE3) -> Mesh:
        """The mesh given in frame b, in frame a; it is no longer that of a file."""
        return Mesh(T_a_b.apply(self.vertices_m), self.triangles)


Solid = Box | Cylinder | Sphere | Mesh
