"""Beams of finite width where an edge is near: which they are, and what their sub-rays meet.

The edges round a body as seen, its rims, span planes with the origin. By how much a beam's axis passes within all of
them tells whether a sub-ray may meet the body, and whether all do. A beam may differ from its axis where its own body
does not fill it, or where another body may be in front.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.sensors.lidar.beams import Beams
from services.sensors.lidar.footprint import Footprint, sub_rays
from services.sensors.rays.bodies import Bodies
from services.sensors.rays.culling import candidates_of, turn_and_shift
from services.sensors.rays.kernels import finite_loop, kernel, loop, part
from services.sensors.rays.lidar_moving import Column, distance_to_planes, is_aside
from services.sensors.rays.ring_table import RingTable
from services.sensors.rays.sections import seen_from

Float = NDArray[np.float64]
Float32 = NDArray[np.float32]

_LANES = 8
"""Sub-rays of a beam that are cast at once; the last repeats the first."""
_BLOCK = 8
"""Columns that share a list of candidates."""
_SAME_M = 1e-5
"""Of two surfaces no farther apart than this the one listed first is met."""


class SubRays(NamedTuple):
    """The sub-rays of R beams in the order of a `RingTable`, seen along the encoder.

    direction, origin_m (3, R, _LANES). start_m, widening: half the width of the bundle at its start, and what is added
    with each metre of range; slope: with each metre outward.
    """

    direction: Float32
    origin_m: Float32
    start_m: float
    widening: float
    slope: float


class Room(NamedTuple):
    """Room to work in, and for the results.

    body, floor, bound, is_near_edge (R,): of each beam of a column the body its axis meets, the least 1 / range of its
    sub-rays on it, the largest on another body, and whether to cast them. rims (3, n): see `_rims`. Of the bodies in
    the column clearance (M, R): by how much each axis passes within the rims; width (M,): half that of the beams there;
    away_m (M,): they are no nearer. ring (R,): of the beams to cast. The arrays from direction to plane hold their
    sub-rays side by side: between which planes they are in a body, what they met first. cells, range_m, face,
    cos_incidence: see `EdgeHits`.
    """

    body: NDArray[np.int32]
    floor: Float32
    bound: Float32
    is_near_edge: NDArray[np.bool_]
    rims: Float32
    clearance: Float32
    width: Float32
    away_m: Float
    ring: NDArray[np.int32]
    direction: Float32
    origin_m: Float32
    entry_m: Float32
    exit_m: Float32
    entry_plane: NDArray[np.int32]
    exit_plane: NDArray[np.int32]
    cast_m: Float32
    plane: NDArray[np.int32]
    cells: NDArray[np.int64]
    range_m: Float32
    face: NDArray[np.int32]
    cos_incidence: Float32


def sub_ray_table(beams: Beams, table: RingTable, footprint: Footprint) -> SubRays:
    """The sub-rays of these beams."""
    elevation, azimuth = beams.elevation_rad[table.ring], beams.azimuth_rad[table.ring]
    flat, rise, zero = np.cos(elevation), np.sin(elevation), np.zeros_like(azimuth)
    axis = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), rise], axis=-1)[:, np.newaxis]
    left = np.stack([-np.sin(azimuth), np.cos(azimuth), zero], axis=-1)[:, np.newaxis]
    where = sub_rays()
    where = np.concatenate([where, where[:1]])
    aside = where[:, :1] * left + where[:, 1:] * np.cross(axis, left)
    direction = axis + np.tan(footprint.divergence_rad / 2) * aside
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    radius = float(np.linalg.norm(where, axis=1).max()) * (1 + 1e-3)
    widening = radius * math.tan(footprint.divergence_rad / 2)
    return SubRays(
        np.ascontiguousarray(direction.transpose(2, 0, 1), dtype=np.float32),
        np.ascontiguousarray((footprint.exit_m / 2 * aside).transpose(2, 0, 1), dtype=np.float32),
        radius * footprint.exit_m / 2,
        widening,
        widening / float(flat.min(initial=1.0)),
    )


def room_for(bodies: Bodies, table: RingTable, num_cells: int) -> Room:
    """Room for scans of so many beams."""
    num_rings, num_sub_rays = len(table.ring), len(sub_rays())
    num_lanes = num_rings * _LANES
    return Room(
        np.empty(num_rings, np.int32),
        np.empty(num_rings, np.float32),
        np.empty(num_rings, np.float32),
        np.empty(num_rings, np.bool_),
        np.empty((3, int(np.diff(bodies.edge_start).max(initial=0))), np.float32),
        np.empty((len(bodies.radii_m), num_rings), np.float32),
        np.empty(len(bodies.radii_m), np.float32),
        np.empty(len(bodies.radii_m)),
        np.empty(num_rings, np.int32),
        np.zeros((3, num_lanes), np.float32),
        np.zeros((3, num_lanes), np.float32),
        np.empty(num_lanes, np.float32),
        np.empty(num_lanes, np.float32),
        np.empty(num_lanes, np.int32),
        np.empty(num_lanes, np.int32),
        np.empty(num_lanes, np.float32),
        np.empty(num_lanes, np.int32),
        np.empty(num_cells, np.int64),
        np.empty((num_cells, num_sub_rays), np.float32),
        np.empty((num_cells, num_sub_rays), np.int32),
        np.empty((num_cells, num_sub_rays), np.float32),
    )


@kernel
def edge_columns(
    bodies: Any,
    body_of_face: NDArray[np.int32],
    table: Any,
    rays: Any,
    frames: Float,
    origins_m: Float,
    limits_m: tuple[float, float],
    face: NDArray[np.int32],
    first_column: int,
    column: Any,
    found: Any,
    room: Any,
    num: int,
) -> int:
    """Adds the cells of these columns to the `num` that `room` holds, and says how many it holds then.

    limits_m: near and far. face (C, R): what the beams' axes meet. first_column: number of the first of these columns.
    """
    reach = rays.start_m, rays.slope
    for first in range(0, len(frames), _BLOCK):
        last = min(first + _BLOCK, len(frames))
        num_found = candidates_of(
            bodies, table, frames[first:last], origins_m[first:last], reach, limits_m[1], column.walls, found
        )
        num_found = _near_block(
            bodies, table, rays, frames[first:last], origins_m[first:last], column, found, num_found, room
        )
        for c in range(first, last):
            _begin(table, body_of_face, face, c, limits_m[1], room)
            kept = 0
            for k in range(num_found):
                if _is_in_column(bodies, found[k], table, rays, frames, origins_m, c, limits_m, column, room, kept):
                    found[k], found[kept] = found[kept], found[k]
                    kept += 1
            for k in range(kept):
                _mark_in_front(bodies, found[k], k, table, rays, frames, c, column, room)
            num = _cast_column(bodies, table, rays, frames, c, limits_m, column, found, kept, room, first_column, num)
    return num


@part
def _begin(table: Any, body_of_face: Any, face: Any, c: int, far_m: float, room: Room) -> None:
    for i in range(len(table.ring)):
        hit = face[c, table.ring[i]]
        room.body[i] = body_of_face[hit] if hit >= 0 else -1
        room.floor[i] = np.float32(0) if hit >= 0 else np.float32(1 / far_m)
        room.is_near_edge[i] = False


@part
def _is_in_column(
    bodies: Any,
    b: int,
    table: Any,
    rays: Any,
    frames: Float,
    origins_m: Float,
    c: int,
    limits_m: Any,
    column: Column,
    room: Room,
    k: int,
) -> bool:
    """Whether a column's sub-rays may meet a body, then its k-th; writes the floor where all do."""
    if is_aside(bodies, b, frames, origins_m, c, table.widest_rad + rays.slope, rays.start_m):
        return False
    bundle = rays.start_m, rays.widening
    if not _is_in_bundles(bodies, b, table, bundle, frames, origins_m, c, column, room, k):
        return False
    if room.away_m[k] > limits_m[0]:
        _raise_floor(bodies, b, k, table, rays, frames, c, column, room)
    return True


@part
def _is_in_bundles(
    bodies: Any,
    b: int,
    table: Any,
    bundle: tuple[float, float],
    frames: Float,
    origins_m: Float,
    c: int,
    column: Column,
    room: Room,
    k: int,
) -> bool:
    """Whether a body may be within half a width at the start of a column's beams, and what is added with each metre."""
    away_m = distance_to_planes(bodies, b, origins_m, c, column.distance_m) - bundle[0]
    corners = bodies.corner_start[b], bodies.corner_start[b + 1]
    seen_from(bodies.corners_m, corners[0], corners[1], frames, origins_m, c, column.corners)
    num_rims = _rims(bodies, b, column, room)
    is_known = away_m > 0 and num_rims > 0
    width = np.float32(1.001 * (bundle[0] / away_m + bundle[1]) + 1e-6 if is_known else np.inf)
    room.width[k], room.away_m[k] = width, away_m
    return bool(_clear_rims(table, num_rims, room.rims, room.clearance[k]) >= -width)


@part
def _near_block(
    bodies: Any,
    table: Any,
    rays: Any,
    frames: Float,
    origins_m: Float,
    column: Column,
    found: Any,
    num_found: int,
    room: Room,
) -> int:
    """Keeps the candidates that are in bundles of the middle column so wide that they hold all sub-rays of a block."""
    middle = len(frames) // 2
    turn, shift_m = turn_and_shift(frames, origins_m, middle)
    bundle = rays.start_m + shift_m, rays.widening + 1.5 * turn
    num = 0
    for k in range(num_found):
        if _is_in_bundles(bodies, found[k], table, bundle, frames, origins_m, middle, column, room, 0):
            found[num] = found[k]
            num += 1
    return num


@part
def _rims(bodies: Any, b: int, column: Column, room: Room) -> int:
    """Writes the planes through the origin and the edges round a body as seen from there; says how many.

    Their normals point inward; a plane through an edge that is seen end-on gets a shorter one, which bounds less.
    """
    num = 0
    corners, distance_m, rims = column.corners, column.distance_m, room.rims
    for e in range(np.uint64(bodies.edge_start[b]), np.uint64(bodies.edge_start[b + 1])):
        is_right = distance_m[bodies.edge_right[e]] > 0
        if (distance_m[bodies.edge_left[e]] > 0) != is_right:
            i, j = bodies.edge_tails[e], bodies.edge_heads[e]
            x = corners[1, i] * corners[2, j] - corners[2, i] * corners[1, j]
            y = corners[2, i] * corners[0, j] - corners[0, i] * corners[2, j]
            z = corners[0, i] * corners[1, j] - corners[1, i] * corners[0, j]
            scale = (1.0 if is_right else -1.0) / (math.sqrt(x * x + y * y + z * z) + 1e-9)
            rims[0, num], rims[1, num], rims[2, num] = (
                np.float32(scale * x),
                np.float32(scale * y),
                np.float32(scale * z),
            )
            num += 1
    return num


@finite_loop
def _clear_rims(table: Any, num_rims: int, rims: Float32, clearance: Float32) -> Any:
    """Writes by how much the axis of each ring passes within all rims; the largest."""
    direction = table.direction
    num_rings = np.uint64(len(clearance))
    for i in range(num_rings):
        clearance[i] = np.float32(1)
    for e in range(0, num_rims, 2):
        f = min(e + 1, num_rims - 1)
        x0, y0, z0 = rims[0, e], rims[1, e], rims[2, e]
        x1, y1, z1 = rims[0, f], rims[1, f], rims[2, f]
        for i in range(num_rings):
            x, y, z = direction[0, i], direction[1, i], direction[2, i]
            inside = min(x0 * x + y0 * y + z0 * z, x1 * x + y1 * y + z1 * z)
            clearance[i] = min(clearance[i], inside)
    largest = np.float32(-1)
    for i in range(num_rings):
        largest = max(largest, clearance[i])
    return largest


@part
def _normal_seen(bodies: Any, p: int, frames: Float, c: int) -> tuple[np.float32, np.float32, np.float32]:
    x, y, z = bodies.normals[0, p], bodies.normals[1, p], bodies.normals[2, p]
    return (
        np.float32(frames[c, 0, 0] * x + frames[c, 0, 1] * y + frames[c, 0, 2] * z),
        np.float32(frames[c, 1, 0] * x + frames[c, 1, 1] * y + frames[c, 1, 2] * z),
        np.float32(frames[c, 2, 0] * x + frames[c, 2, 1] * y + frames[c, 2, 2] * z),
    )


@loop
def _bound(
    bodies: Any, b: int, table: Any, rays: Any, frames: Float, c: int, column: Column, room: Room, sign: int
) -> None:
    """Writes the largest (sign 1) or least (-1) 1 / range at which sub-rays may meet a body."""
    num_rings = np.uint64(len(room.bound))
    for i in range(num_rings):
        room.bound[i] = np.float32(np.inf)
    for p in range(bodies.plane_start[b], bodies.plane_start[b + 1]):
        nearest_m = column.distance_m[p] - sign * rays.start_m
        if nearest_m <= 0 and (sign > 0 or column.distance_m[p] < -rays.start_m):
            continue
        x, y, z = _normal_seen(bodies, p, frames, c)
        scale = np.float32(1 / max(nearest_m, 1e-6))
        slack = np.float32(sign * (1.01 * rays.widening + 1e-6))
        if sign < 0 and column.distance_m[p] <= rays.start_m:
            scale = np.float32(0)
        for i in range(num_rings):
            direction = x * table.direction[0, i] + y * table.direction[1, i] + z * table.direction[2, i]
            inverse = scale * (slack - direction)
            room.bound[i] = inverse if inverse < room.bound[i] else room.bound[i]


@part
def _raise_floor(
    bodies: Any, b: int, k: int, table: Any, rays: Any, frames: Float, c: int, column: Column, room: Room
) -> None:
    """Where a body fills the beams whose axes meet it: their sub-rays meet nothing farther than that."""
    body, clearance, width = room.body, room.clearance[k], room.width[k]
    is_met = False
    for i in range(np.uint64(len(body))):
        is_met |= (body[i] == b) & (clearance[i] > width)
    if is_met:
        _bound(bodies, b, table, rays, frames, c, column, room, -1)
        for i in range(np.uint64(len(body))):
            is_filled = (body[i] == b) & (clearance[i] > width)
            room.floor[i] = room.bound[i] if is_filled else room.floor[i]


@part
def _mark_in_front(
    bodies: Any, b: int, k: int, table: Any, rays: Any, frames: Float, c: int, column: Column, room: Room
) -> None:
    """Marks beams whose sub-rays may meet this body before the one that their axes meet."""
    body, clearance, width = room.body, room.clearance[k], room.width[k]
    is_other = False
    for i in range(np.uint64(len(body))):
        is_other |= (body[i] != b) & (clearance[i] >= -width)
    if is_other:
        _bound(bodies, b, table, rays, frames, c, column, room, 1)
        for i in range(np.uint64(len(body))):
            is_in_front = (body[i] != b) & (clearance[i] >= -width) & (room.bound[i] >= room.floor[i])
            room.is_near_edge[i] |= is_in_front


@part
def _cast_column(
    bodies: Any,
    table: Any,
    rays: Any,
    frames: Float,
    c: int,
    limits_m: Any,
    column: Column,
    found: Any,
    kept: int,
    room: Room,
    first_column: int,
    num: int,
) -> int:
    """Casts the sub-rays of all beams of a column that are marked, and keeps the beams that have an edge."""
    num_cast = _gather(table, rays, np.float32(1 / limits_m[1]), np.float32(limits_m[1]), room)
    for k in range(kept):
        first, last = 0, num_cast
        while first < last and room.clearance[k, table.place[room.ring[first]]] < -room.width[k]:
            first += 1
        while first < last and room.clearance[k, table.place[room.ring[last - 1]]] < -room.width[k]:
            last -= 1
        if first < last:
            _cast(bodies, found[k], frames, c, np.float32(limits_m[0]), column, room, first, last)
    for n in range(num_cast):
        if _has_edge(bodies, room, n * _LANES):
            room.cells[num] = (first_column + c) * len(table.place) + room.ring[n]
            _keep(bodies, room, frames, c, n * _LANES, num)
            num += 1
    return num


@part
def _gather(table: Any, rays: Any, least: Any, far_m: Any, room: Room) -> int:
    """Lays the sub-rays of the beams to cast side by side, and counts those beams."""
    for i in range(np.uint64(len(room.body))):
        room.is_near_edge[i] |= (room.body[i] >= 0) & (room.floor[i] < least)
    num = 0
    for r in range(len(table.place)):
        i = table.place[r]
        if room.is_near_edge[i]:
            for axis in range(3):
                for n in range(_LANES):
                    room.direction[axis, num * _LANES + n] = rays.direction[axis, i, n]
                    room.origin_m[axis, num * _LANES + n] = rays.origin_m[axis, i, n]
            room.ring[num] = r
            num += 1
    for n in range(num * _LANES):
        room.cast_m[n] = far_m
    for n in range(num * _LANES):
        room.plane[n] = -1
    return num


@loop
def _cast(
    bodies: Any, b: int, frames: Float, c: int, near_m: Any, column: Column, room: Room, first: int, last: int
) -> None:
    """Casts the sub-rays of some beams against a body.

    They are in it from the last plane at which they enter to the first at which they leave.
    """
    start, end = np.uint64(first * _LANES), np.uint64(last * _LANES)
    for n in range(start, end):
        room.entry_m[n] = np.float32(-np.inf)
    for n in range(start, end):
        room.exit_m[n] = np.float32(np.inf)
    for p in range(bodies.plane_start[b], bodies.plane_start[b + 1]):
        _narrow(np.int32(p), _normal_seen(bodies, p, frames, c), np.float32(column.distance_m[p]), room, start, end)
    for n in range(start, end):
        is_before = room.entry_m[n] >= near_m
        range_m = room.entry_m[n] if is_before else room.exit_m[n]
        is_hit = (room.entry_m[n] <= room.exit_m[n]) & (range_m >= near_m)
        if is_hit & (range_m < room.cast_m[n] - np.float32(_SAME_M)):
            room.cast_m[n] = range_m
            room.plane[n] = room.entry_plane[n] if is_before else room.exit_plane[n]


@loop
def _narrow(p: Any, normal: Any, before_m: Any, room: Room, start: Any, end: Any) -> None:
    """Narrows where sub-rays are in a body by where they meet a plane of it, from so far before it on."""
    x, y, z = normal
    direction, origin_m = room.direction, room.origin_m
    entry_m, exit_m, entry_plane, exit_plane = room.entry_m, room.exit_m, room.entry_plane, room.exit_plane
    for n in range(start, end):
        along = x * direction[0, n] + y * direction[1, n] + z * direction[2, n]
        range_m = -(before_m + x * origin_m[0, n] + y * origin_m[1, n] + z * origin_m[2, n]) / along
        is_later = (along < 0) & (range_m > entry_m[n])
        is_sooner = (along >= 0) & (range_m < exit_m[n])
        entry_m[n] = range_m if is_later else entry_m[n]
        entry_plane[n] = p if is_later else entry_plane[n]
        exit_m[n] = range_m if is_sooner else exit_m[n]
        exit_plane[n] = p if is_sooner else exit_plane[n]


@part
def _has_edge(bodies: Any, room: Room, first: int) -> bool:
    """Whether not all sub-rays of a beam meet one surface."""
    num_same = 0
    for n in range(_LANES):
        num_same += _surface(bodies, room.plane[first + n]) == _surface(bodies, room.plane[first])
    return num_same < _LANES


@part
def _surface(bodies: Any, p: int) -> Any:
    return bodies.surface_of_plane[p] if p >= 0 else np.int32(-1)


@part
def _keep(bodies: Any, room: Room, frames: Float, c: int, first: int, num: int) -> None:
    for n in range(_LANES - 1):
        k = first + n
        p = room.plane[k]
        room.range_m[num, n], room.face[num, n] = np.float32(np.inf), np.int32(-1)
        room.cos_incidence[num, n] = np.float32(0)
        if p >= 0:
            x, y, z = _normal_seen(bodies, p, frames, c)
            along = x * room.direction[0, k] + y * room.direction[1, k] + z * room.direction[2, k]
            room.range_m[num, n], room.face[num, n] = room.cast_m[k], bodies.face[p]
            room.cos_incidence[num, n] = min(abs(along), np.float32(1))
