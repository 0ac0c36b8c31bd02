"""How deep convex solids are in one another: by separating axes, for many pairs at once.

Boxes and many-sided prisms are zonotopes, sums of segments: all there is to know of one is its centre, its generators
(half an edge each) and the normals of its faces. Triangles are the faces of meshes and are entered from outside only.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared.geometry import Float
from shared.solids import Box, Cylinder, Sphere

NUM_PRISM_SIDES = 32
"""A cylinder is checked as the prism round it, whose edges stand out by 0.5 % of the radius."""

_CHUNK = 4096
"""Pairs that are judged at a time, which bounds memory."""
_PARALLEL = 1e-7
"""Sine between two edges below which they span no axis."""


@dataclass(frozen=True, slots=True, eq=False)
class Zonotopes:
    """Solids of one kind: centres (..., 3), generators (..., G, 3) in metres, normals (..., F, 3), unit, up to sign."""

    centres: Float
    generators: Float
    normals: Float

    def reach(self) -> Float:
        """Half sizes (..., 3) of the boxes along the axes that hold them."""
        reach: Float = np.abs(self.generators).sum(axis=-2)
        return reach

    def at(self, index: Any) -> Zonotopes:
        """Those at an index into the leading dimensions."""
        return Zonotopes(self.centres[index], self.generators[index], self.normals[index])

    def moved(self, T: Float) -> Zonotopes:
        """Mapped by matrices T (..., 4, 4) that broadcast with the leading dimensions."""
        R_T = T[..., :3, :3].swapaxes(-1, -2)
        centres = (self.centres[..., None, :] @ R_T)[..., 0, :] + T[..., :3, 3]
        return Zonotopes(centres, self.generators @ R_T, self.normals @ R_T)


def zonotope(solid: Box | Cylinder | Sphere) -> Zonotopes:
    """The one (no leading dimension) that is the box, or the smallest regular prism or cube round the others."""
    match solid:
        case Box(size_m):
            return Zonotopes(np.zeros(3), np.diag(size_m) / 2, np.eye(3))
        case Sphere(radius_m):
            return Zonotopes(np.zeros(3), np.eye(3) * radius_m, np.eye(3))
        case Cylinder(radius_m, length_m):
            angle = 2 * np.pi / NUM_PRISM_SIDES * np.arange(NUM_PRISM_SIDES // 2)
            zero, along = np.zeros_like(angle), np.array([[0.0, 0.0, 1.0]])
            edges = np.column_stack([np.cos(angle), np.sin(angle), zero])
            normals = np.column_stack([-np.sin(angle), np.cos(angle), zero])
            half_edge_m = radius_m * np.tan(np.pi / NUM_PRISM_SIDES)
            generators = np.concatenate([half_edge_m * edges, length_m / 2 * along])
            return Zonotopes(np.zeros(3), generators, np.concatenate([normals, along]))


def stacked(solids: Sequence[Zonotopes]) -> Zonotopes:
    """Single solids of one kind as one, (N)."""
    return Zonotopes(
        np.stack([solid.centres for solid in solids]),
        np.stack([solid.generators for solid in solids]),
        np.stack([solid.normals for solid in solids]),
    )


def depths(a: Zonotopes, b: Zonotopes) -> Float:
    """How far a and b (N each) must at least be moved apart (N,), in metres, so that they only touch.

    Exact where positive. Where negative the two are apart, by the absolute value at least.
    """
    return _chunked(lambda rows: _depths(a.at(rows), b.at(rows)), len(a.centres))


def depths_in_faces(a: Zonotopes, corners: Float, normals: Float) -> Float:
    """The same for a (N) and triangles: corners (N, 3, 3), unit normals (N, 3) that point out of the solid.

    A solid is moved out of a face to its outside or past its edges, never through it to the inside. The edges of a face
    that is cut into triangles count too, so that the largest depth of all triangles may end at half the solid's width.
    """
    return _chunked(lambda rows: _depths_in_faces(a.at(rows), corners[rows], normals[rows]), len(normals))


def _chunked(judge: Callable[[slice], Float], num: int) -> Float:
    parts = [judge(slice(start, start + _CHUNK)) for start in range(0, num, _CHUNK)]
    return np.concatenate([np.empty(0), *parts])


def _depths(a: Zonotopes, b: Zonotopes) -> Float:
    crosses, is_axis = _crosses(a.generators, b.generators)
    axes = np.concatenate([a.normals, b.normals, crosses], axis=1)
    distance = np.abs(axes @ (b.centres - a.centres)[..., None])[..., 0]
    overlap = _half_width(axes, a.generators) + _half_width(axes, b.generators) - distance
    overlap[:, -is_axis.shape[1] :][~is_axis] = np.inf
    depth: Float = overlap.min(axis=1)
    return depth


def _depths_in_faces(a: Zonotopes, corners: Float, normals: Float) -> Float:
    crosses, is_axis = _crosses(a.generators, np.roll(corners, -1, axis=1) - corners)
    axes = np.concatenate([normals[:, None], a.normals, crosses], axis=1)
    middle = (axes @ a.centres[..., None])[..., 0]
    half = _half_width(axes, a.generators)
    face = axes @ corners.swapaxes(1, 2)
    outwards, inwards = face.max(axis=2) - (middle - half), (middle + half) - face.min(axis=2)
    facing = (axes @ normals[..., None])[..., 0]
    outwards[(facing < -_PARALLEL) & (outwards > 0)] = np.inf  # that way leads through the face to the inside
    inwards[(facing > _PARALLEL) & (inwards > 0)] = np.inf
    overlap = np.minimum(outwards, inwards)
    overlap[:, -is_axis.shape[1] :][~is_axis] = np.inf
    depth: Float = overlap.min(axis=1)
    return depth


def _half_width(axes: Float, generators: Float) -> Float:
    """Of solids (N, G, 3) along their axes (N, X, 3): (N, X)."""
    width: Float = np.abs(axes @ generators.swapaxes(1, 2)).sum(axis=2)
    return width


def _crosses(a: Float, b: Float) -> tuple[Float, NDArray[np.bool_]]:
    """Unit vectors (N, A * B, 3) across each pair of the edges (N, A, 3) and (N, B, 3); and which of them exist."""
    a = a / np.linalg.norm(a, axis=2, keepdims=True)
    b = b / np.linalg.norm(b, axis=2, keepdims=True)
    a, b = a[:, :, None], b[:, None]
    across = np.stack(
        [
            a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1],
            a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2],
            a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0],
        ],
        axis=-1,
    ).reshape(len(a), -1, 3)
    length = np.linalg.norm(across, axis=2)
    return across / np.maximum(length, _PARALLEL)[..., None], length > _PARALLEL
