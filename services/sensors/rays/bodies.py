"""The scene as convex bodies: each bounded by planes, with its corners, its edges and a box around it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.sensors.scene import Scene

Float = NDArray[np.float64]
Ints = NDArray[np.int32]

_MIN_AREA_M2 = 1e-12
"""A smaller face is no face: its plane is not known."""
_SIDE_MARGIN_M = 1e-6
"""The sides of a lone face stand off by this, so that no ray slips between two neighbours."""


class Bodies(NamedTuple):
    """M convex bodies of P planes, V corners, E edges; also what the kernels take, then with world coordinates.

    corners_m (3, V), those of body b from corner_start[b] to corner_start[b + 1]; planes and edges likewise.
    normals (3, P) point outward, offsets_m (P,): n @ p = offset on the plane. face (P,): its number in the scene. The
    outline of plane p is the edges outline_tails[i] -> outline_heads[i], i from outline_start[p] to
    outline_start[p + 1], corners counted from the body's first; a plane that is never met itself has none.
    The planes on both sides of edge i, seen from outside, are edge_left[i] and edge_right[i].
    centres_m (3, M), half_axes_m (M, 3, 3), radii_m (M,): a box around each body, its half axes as columns, and a ball.
    link (M,): what it is fixed to. surface_of_plane (P,): the `surfaces_of` its face.
    """

    corners_m: Float
    corner_start: Ints
    normals: Float
    offsets_m: Float
    face: Ints
    plane_start: Ints
    outline_tails: Ints
    outline_heads: Ints
    outline_start: Ints
    edge_tails: Ints
    edge_heads: Ints
    edge_left: Ints
    edge_right: Ints
    edge_start: Ints
    centres_m: Float
    half_axes_m: Float
    radii_m: Float
    link: Ints
    surface_of_plane: Ints


def surfaces_of(scene: Scene) -> Ints:
    """Which surface each face belongs to (F,): all faces of a convex shape are one, else those in one plane."""
    plane = np.where(scene.is_convex[scene.shape], 0, scene.face + 1)
    return _numbers_of_rows(np.column_stack([scene.shape, plane]))


def bodies_of(scene: Scene) -> Bodies:
    """A body for each convex shape, and a flat one for each face of the others; faces without area are left out."""
    faces = _faces_of(scene)
    planes = _in_order_of_bodies(_joined(faces.fronts, faces.backs, faces.sides))
    centres_m, half_axes_m, radii_m = _boxes(faces, planes)
    edges = _edges_of(planes)
    return Bodies(
        corners_m=np.ascontiguousarray(faces.corners_m.T),
        corner_start=_starts(faces.body_of_corner, faces.num_bodies),
        normals=np.ascontiguousarray(planes.normals.T),
        offsets_m=planes.offsets_m,
        face=planes.face.astype(np.int32),
        plane_start=_starts(planes.body, faces.num_bodies),
        outline_tails=planes.tails.astype(np.uint32),
        outline_heads=planes.heads.astype(np.uint32),
        outline_start=_ends(planes.sizes),
        edge_tails=edges[:, 1].astype(np.uint32),
        edge_heads=edges[:, 2].astype(np.uint32),
        edge_left=edges[:, 3].astype(np.uint32),
        edge_right=edges[:, 4].astype(np.uint32),
        edge_start=_starts(edges[:, 0], faces.num_bodies),
        centres_m=np.ascontiguousarray(centres_m.T),
        half_axes_m=np.ascontiguousarray(half_axes_m.transpose(0, 2, 1)),
        radii_m=radii_m,
        link=faces.link,
        surface_of_plane=surfaces_of(scene)[planes.face],
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Planes:
    """Of each the body, the normal, the offset, the face, how many edges its outline has, and those edges."""

    body: NDArray[np.int64]
    normals: Float
    offsets_m: Float
    face: NDArray[np.int64]
    sizes: NDArray[np.int64]
    tails: NDArray[np.int64]
    heads: NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class _Faces:
    """The corners of all bodies, each once, and the planes: of faces, of their backs where they are lone, of sides."""

    num_bodies: int
    corners_m: Float
    body_of_corner: NDArray[np.int64]
    fronts: _Planes
    backs: _Planes
    sides: _Planes
    link: Ints


def _faces_of(scene: Scene) -> _Faces:
    normals, is_face = _normals(scene)
    sizes, face = np.diff(scene.starts)[is_face], np.flatnonzero(is_face)
    vertices_m = scene.vertices_m[np.repeat(is_face, np.diff(scene.starts))]
    shape, normals = scene.shape[is_face], normals[is_face]
    is_lone = ~scene.is_convex[shape]
    body = _numbers_of_rows(np.column_stack([shape, np.where(is_lone, face + 1, 0)])).astype(np.int64)
    first_face = np.flatnonzero(np.diff(body, prepend=-1))
    corners_m, body_of_corner, corner = _without_repeats(vertices_m, np.repeat(body, sizes))
    starts = np.cumsum(sizes) - sizes
    following = _rolled(sizes)
    fronts = _Planes(
        body, normals, np.einsum("fc,fc->f", normals, vertices_m[starts]), face, sizes, corner, corner[following]
    )
    has_side = np.repeat(is_lone, sizes)
    along = vertices_m[following] - vertices_m
    outward = np.cross(along, np.repeat(normals, sizes, axis=0))
    length = np.linalg.norm(outward, axis=1)
    has_side &= length > 0
    outward = outward[has_side] / length[has_side, np.newaxis]
    nothing = np.empty(0, dtype=np.int64)
    sides = _Planes(
        np.repeat(body, sizes)[has_side],
        outward,
        np.einsum("ec,ec->e", outward, vertices_m[has_side]) + _SIDE_MARGIN_M,
        np.repeat(face, sizes)[has_side],
        np.zeros(len(outward), dtype=np.int64),
        nothing,
        nothing,
    )
    lone = np.repeat(is_lone, sizes)
    backs = _Planes(  # from the last to the first, so that each outline runs backwards too
        body[is_lone][::-1],
        -normals[is_lone][::-1],
        -fronts.offsets_m[is_lone][::-1],
        face[is_lone][::-1],
        sizes[is_lone][::-1],
        fronts.heads[lone][::-1],
        fronts.tails[lone][::-1],
    )
    return _Faces(
        num_bodies=len(first_face),
        corners_m=corners_m,
        body_of_corner=body_of_corner,
        fronts=fronts,
        backs=backs,
        sides=sides,
        link=scene.shape_link[shape[first_face]].astype(np.int32),
    )


def _edges_of(planes: _Planes) -> NDArray[np.int64]:
    """Of each edge where two planes join the body, tail, head, and the planes to its left and right (E, 5)."""
    tails, heads = planes.tails, planes.heads
    plane = np.repeat(np.arange(len(planes.body)), planes.sizes)
    rows = np.column_stack([planes.body[plane], np.minimum(tails, heads), np.maximum(tails, heads), tails > heads])
    order = np.lexsort(rows.T[::-1])
    rows, plane = rows[order], plane[order]
    is_joint = (np.diff(rows, axis=0) == [0, 0, 0, 1]).all(axis=1)
    return np.column_stack([rows[:-1, :3][is_joint], plane[:-1][is_joint], plane[1:][is_joint]])


def _normals(scene: Scene) -> tuple[Float, NDArray[np.bool_]]:
    """Unit normals of all faces by Newell's method, and whether each face has one."""
    sizes = np.diff(scene.starts)
    if not len(sizes):
        return np.empty((0, 3)), np.empty(0, dtype=np.bool_)
    from_first = scene.vertices_m - np.repeat(scene.vertices_m[scene.starts[:-1]], sizes, axis=0)
    twice_area = np.add.reduceat(np.cross(from_first, from_first[_rolled(sizes)]), scene.starts[:-1], axis=0)
    length = np.linalg.norm(twice_area, axis=1)
    return twice_area / np.maximum(length, 1e-300)[:, np.newaxis], length > _MIN_AREA_M2


def _without_repeats(vertices_m: Float, body: NDArray[np.int64]) -> tuple[Float, NDArray[np.int64], NDArray[np.int64]]:
    """The corners, the body of each, and for every vertex which of its body's corners it is."""
    rows = np.column_stack([body, np.round(vertices_m * 1e9).astype(np.int64)])
    order = np.lexsort(rows.T[::-1])
    is_new = np.any(np.diff(rows[order], axis=0, prepend=-1), axis=1)
    number = np.empty(len(rows), dtype=np.int64)
    number[order] = np.cumsum(is_new) - 1
    chosen = order[is_new]
    first = np.searchsorted(body[chosen], np.arange(body[-1] + 1 if len(body) else 0))
    return vertices_m[chosen], body[chosen], number - first[body]


def _boxes(faces: _Faces, planes: _Planes) -> tuple[Float, Float, Float]:
    """Centres, half axes and radii of boxes that lie along each body's first face and its first edge."""
    if not faces.num_bodies:
        return np.empty((0, 3)), np.empty((0, 3, 3)), np.empty(0)
    corner_start = _starts(faces.body_of_corner, faces.num_bodies)
    first_plane = _starts(planes.body, faces.num_bodies)[:-1]
    first_edge = _ends(planes.sizes)[first_plane]
    z = planes.normals[first_plane]
    ends = [faces.corners_m[corner_start[:-1] + which[first_edge]] for which in (planes.heads, planes.tails)]
    x = _unit_across(ends[0] - ends[1], z)
    axes = np.stack([x, np.cross(z, x), z], axis=1)
    along = np.einsum("vij,vj->vi", axes[faces.body_of_corner], faces.corners_m)
    low, high = (pick.reduceat(along, corner_start[:-1], axis=0) for pick in (np.minimum, np.maximum))
    centres_m = np.einsum("bij,bi->bj", axes, (low + high) / 2)
    half_m = (high - low) / 2
    return centres_m, axes * half_m[:, :, np.newaxis], np.linalg.norm(half_m, axis=1)


def _unit_across(directions: Float, normals: Float) -> Float:
    """Unit vectors across the normals, along the directions where these are not zero."""
    least = np.eye(3)[np.argmin(np.abs(normals), axis=1)]
    is_short = np.linalg.norm(directions, axis=1, keepdims=True) < 1e-9
    across = np.cross(np.cross(normals, np.where(is_short, least, directions)), normals)
    unit: Float = across / np.linalg.norm(across, axis=1, keepdims=True)
    return unit


def _joined(*parts: _Planes) -> _Planes:
    names = _Planes.__slots__
    return _Planes(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


def _in_order_of_bodies(planes: _Planes) -> _Planes:
    order = np.argsort(planes.body, kind="stable")
    starts = np.cumsum(planes.sizes) - planes.sizes
    sizes = planes.sizes[order]
    edge = np.repeat(starts[order] - (np.cumsum(sizes) - sizes), sizes) + np.arange(sizes.sum())
    return _Planes(
        planes.body[order],
        planes.normals[order],
        planes.offsets_m[order],
        planes.face[order],
        sizes,
        planes.tails[edge],
        planes.heads[edge],
    )


def _rolled(sizes: NDArray[np.int64]) -> NDArray[np.int64]:
    """Of each vertex of outlines laid end to end, which one follows."""
    following = np.arange(1, sizes.sum() + 1)
    ends = np.cumsum(sizes)
    following[ends - 1] = ends - sizes
    return following


def _starts(groups: NDArray[np.int64], num_groups: int) -> Ints:
    """Where each of the sorted groups begins, and the end."""
    return np.searchsorted(groups, np.arange(num_groups + 1)).astype(np.int32)


def _ends(sizes: NDArray[np.int64]) -> Ints:
    return np.concatenate([[0], np.cumsum(sizes)]).astype(np.int32)


def _numbers_of_rows(rows: NDArray[Any]) -> Ints:
    _, numbers = np.unique(rows, axis=0, return_inverse=True)
    return numbers.reshape(-1).astype(np.int32)
