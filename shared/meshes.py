"""Closed triangle meshes of solids, in the solid's own frame, wound counter-clockwise seen from outside."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared.solids import Box, Cylinder, Mesh, Solid, Sphere

_NUM_SEGMENTS = 32
"""Facets round a cylinder or sphere: the sagitta of a 20 mm piston is then 0.1 mm, far below the range noise."""


def mesh_of(solid: Solid) -> Mesh:
    """The triangles of a solid; triangle i of a box is on face i % 6 of -x, +x, -y, +y, -z, +z."""
    match solid:
        case Box(size_m):
            return box(size_m)
        case Cylinder(radius_m, length_m):
            return cylinder(radius_m, length_m)
        case Sphere(radius_m):
            return sphere(radius_m)
        case Mesh():
            return solid


@dataclass(frozen=True, slots=True, eq=False)
class Polygons:
    """Convex polygons, each wound counter-clockwise seen from outside.

    vertices_m (V, 3): of all, one after the other. sizes (P,): how many each has. faces (P,): see `faces_of`.
    is_convex: whether they bound one convex body.
    """

    vertices_m: NDArray[np.float64]
    sizes: NDArray[np.int64]
    faces: NDArray[np.int32]
    is_convex: bool


def polygons_of(solid: Solid) -> Polygons:
    """The boundary of a solid as few convex polygons; the same surface as that of `mesh_of(solid)`."""
    mesh = mesh_of(solid)
    match solid:
        case Box():
            return _polygons(mesh, list(_quads(mesh)), np.arange(6))
        case Cylinder():
            sides, ring = _quads(mesh, _NUM_SEGMENTS), np.arange(_NUM_SEGMENTS)
            rows = [*sides, ring[::-1], ring + _NUM_SEGMENTS]
            return _polygons(mesh, rows, np.repeat(np.arange(3), [_NUM_SEGMENTS, 1, 1]))
        case Sphere():
            rows = [_without_repeats(mesh, row) for row in _quads(mesh)]
            return _polygons(mesh, rows, np.zeros(len(rows)))
        case Mesh():
            sizes = np.full(len(mesh.triangles), 3, dtype=np.int64)
            vertices_m = mesh.vertices_m.astype(np.float64)[mesh.triangles].reshape(-1, 3)
            return Polygons(vertices_m, sizes, faces_of(solid), is_convex=False)


def _polygons(mesh: Mesh, rows: Sequence[NDArray[np.integer]], faces: NDArray[np.integer | np.floating]) -> Polygons:
    sizes = np.array([len(row) for row in rows], dtype=np.int64)
    vertices_m = mesh.vertices_m.astype(np.float64)[np.concatenate(rows)]
    return Polygons(vertices_m, sizes, faces.astype(np.int32), is_convex=True)


def _quads(mesh: Mesh, num_quads: int | None = None) -> NDArray[np.uint32]:
    """(Q, 4): undoes `_triangulated`, whose second half continues the quads of its first."""
    num_quads = len(mesh.triangles) // 2 if num_quads is None else num_quads
    first, second = mesh.triangles[:num_quads], mesh.triangles[num_quads : 2 * num_quads]
    return np.column_stack([first, second[:, 2]])


def _without_repeats(mesh: Mesh, row: NDArray[np.integer]) -> NDArray[np.integer]:
    """The corners of a polygon that do not coincide with the one before: a quad at a sphere's pole is a triangle."""
    corners = mesh.vertices_m[row]
    is_apart = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1) > 1e-9 * np.abs(corners).max()
    kept: NDArray[np.integer] = row[is_apart]
    return kept


def faces_of(solid: Solid) -> NDArray[np.int32]:
    """Which face of a solid each triangle of `mesh_of(solid)` belongs to, (T,).

    Box: 0 to 5 for -x, +x, -y, +y, -z, +z. Cylinder: 0 the side, 1 the bottom, 2 the top. Sphere: 0. Mesh: triangles in
    one plane share a number, to 0.1 mm and 0.01 of their normal.
    """
    num_triangles = len(mesh_of(solid).triangles)
    match solid:
        case Box():
            return np.arange(num_triangles, dtype=np.int32) % 6
        case Cylinder():
            num_cap = _NUM_SEGMENTS - 2
            return np.repeat(np.arange(3, dtype=np.int32), [2 * _NUM_SEGMENTS, num_cap, num_cap])
        case Sphere():
            return np.zeros(num_triangles, dtype=np.int32)
        case Mesh():
            return _planes_of(solid)


def _planes_of(mesh: Mesh) -> NDArray[np.int32]:
    corners = mesh.vertices_m.astype(np.float64)[mesh.triangles]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)
    offsets_m = np.einsum("tc,tc->t", normals, corners.mean(axis=1))
    planes = np.round(np.column_stack([normals * 100, offsets_m * 10_000]))
    _, numbers = np.unique(planes + 0.0, axis=0, return_inverse=True)
    return numbers.reshape(-1).astype(np.int32)


def box(size_m: Sequence[float]) -> Mesh:
    """A box of edge lengths x, y, z."""
    signs = np.array([[(i >> axis & 1) - 0.5 for axis in range(3)] for i in range(8)])
    quads = [(0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6)]
    return Mesh(signs * np.asarray(size_m, dtype=np.float64), _triangulated(quads))


def cylinder(radius_m: float, length_m: float) -> Mesh:
    """A cylinder along z."""
    angle = 2 * np.pi / _NUM_SEGMENTS * np.arange(_NUM_SEGMENTS)
    ring = np.stack([radius_m * np.cos(angle), radius_m * np.sin(angle)], axis=1)
    bottom, top = (np.column_stack([ring, np.full(_NUM_SEGMENTS, z)]) for z in (-length_m / 2, length_m / 2))
    i = np.arange(_NUM_SEGMENTS)
    j = (i + 1) % _NUM_SEGMENTS
    sides = _triangulated(np.stack([i, j, j + _NUM_SEGMENTS, i + _NUM_SEGMENTS], axis=1))
    fan = np.stack([np.zeros(_NUM_SEGMENTS - 2, dtype=int), i[1:-1], j[1:-1]], axis=1)
    caps = np.concatenate([fan[:, ::-1], fan + _NUM_SEGMENTS]).astype(np.uint32)
    return Mesh(np.concatenate([bottom, top]), np.concatenate([sides, caps]))


def sphere(radius_m: float) -> Mesh:
    """A sphere of rings of latitude; those at the poles collapse to a point each."""
    num_rings = _NUM_SEGMENTS // 2 + 1
    latitude = np.linspace(-np.pi / 2, np.pi / 2, num_rings)[:, np.newaxis]
    longitude = 2 * np.pi / _NUM_SEGMENTS * np.arange(_NUM_SEGMENTS)[np.newaxis, :]
    x, y = np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude)
    z = np.broadcast_to(np.sin(latitude), x.shape)
    i = np.arange(_NUM_SEGMENTS)
    ring = np.stack([i, np.roll(i, -1), np.roll(i, -1) + _NUM_SEGMENTS, i + _NUM_SEGMENTS], axis=1)
    quads = np.concatenate([ring + k * _NUM_SEGMENTS for k in range(num_rings - 1)])
    return Mesh(radius_m * np.stack([x, y, z], axis=-1).reshape(-1, 3), _triangulated(quads))


def merged(meshes: Sequence[Mesh]) -> Mesh:
    """All meshes as one, without triangles if there is none; they must share a frame."""
    if not meshes:
        return Mesh(np.empty((0, 3)), np.empty((0, 3), dtype=np.uint32))
    offsets = np.cumsum([0] + [len(mesh.vertices_m) for mesh in meshes[:-1]])
    triangles = [mesh.triangles + np.uint32(offset) for mesh, offset in zip(meshes, offsets, strict=True)]
    return Mesh(np.concatenate([mesh.vertices_m for mesh in meshes]), np.concatenate(triangles))


def area_m2(mesh: Mesh) -> float:
    """The area of all triangles."""
    a, b, c = np.moveaxis(mesh.vertices_m[mesh.triangles], 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def volume_m3(mesh: Mesh) -> float:
    """The volume that a closed mesh encloses; negative if it is wound inside out."""
    centred = mesh.vertices_m - mesh.vertices_m.mean(axis=0)
    a, b, c = np.moveaxis(centred[mesh.triangles], 1, 0)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def is_closed(mesh: Mesh) -> bool:
    """Whether each edge of each triangle is met by exactly one neighbour, which runs along it the other way."""
    starts, ends = mesh.triangles.astype(np.int64).ravel(), np.roll(mesh.triangles, -1, axis=1).astype(np.int64).ravel()
    forth = np.sort(starts * len(mesh.vertices_m) + ends)
    back = np.sort(ends * len(mesh.vertices_m) + starts)
    return bool(np.array_equal(forth, back) and np.all(np.diff(forth) > 0))


def _triangulated(quads: Sequence[tuple[int, int, int, int]] | NDArray[np.integer]) -> NDArray[np.uint32]:
    a, b, c, d = np.asarray(quads, dtype=np.uint32).T
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
