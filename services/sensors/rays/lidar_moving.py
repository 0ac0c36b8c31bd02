"""A scan whose columns each have a frame of their own, with beams of any azimuths."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.sensors.rays.bodies import Bodies
from services.sensors.rays.culling import candidates_of, half_extent_m
from services.sensors.rays.kernels import finite_loop, kernel, loop, part
from services.sensors.rays.sections import cut, rings_between, seen_from

Float = NDArray[np.float64]

_BLOCK = 8
"""Columns that share a list of candidates."""
_MARGIN = 1e-6
"""Rings that look so near the border of what surely fills a group's width are tested one by one."""
_TOLERANCE = 2e-7
"""Faces reach beyond their edges by this angle where each ring is tested."""
_ASIDE, _ACROSS, _INSIDE = 0, 1, 2
_MIN_DISTANCE_M = 1e-9
"""A face whose plane the beams begin in is not met."""


class Column(NamedTuple):
    """What is known of the column at hand.

    nearest (R,): 1 / range of each ring in the table's order, and plane (R,) it is on, -1 for none. distance_m (P,): of
    the beams' origin from each plane; height_m (P,): its amount, where it counts. corners (3, n): of a body, as
    `seen_from`; seen (5, n): the same, turned to a group of rings, see `cut`. clearance (R,): see `_clear_edges`.
    walls (3, 3): see `candidates_of`.
    """

    nearest: NDArray[np.float32]
    plane: NDArray[np.int32]
    distance_m: Float
    height_m: NDArray[np.float32]
    corners: Float
    seen: Float
    clearance: NDArray[np.float32]
    walls: Float


@kernel
def scan_columns(
    bodies: Any,
    table: Any,
    frames: Float,
    origins_m: Float,
    near_m: float,
    far_m: float,
    hits: Any,
    column: Any,
    found: Any,
) -> None:
    """Writes range_m, face, cos_incidence (C, R), the arrays of `hits`, of C columns with these frames and origins."""
    for first in range(0, len(frames), _BLOCK):
        last = min(first + _BLOCK, len(frames))
        num_found = candidates_of(
            bodies, table, frames[first:last], origins_m[first:last], (0.0, 0.0), far_m, column.walls, found
        )
        for c in range(first, last):
            column.nearest[:] = 1 / far_m
            column.plane[:] = -1
            for k in range(num_found):
                _draw_body(bodies, found[k], table, frames, origins_m, c, near_m, column)
            _write(bodies, table, column, c, hits[0], hits[1], hits[2])


def column_for(bodies: Bodies, num_rings: int) -> Column:
    """Room for a column of so many rings."""
    num_corners = int(np.diff(bodies.corner_start).max(initial=0))
    return Column(
        np.empty(num_rings, np.float32),
        np.empty(num_rings, np.int32),
        np.empty(len(bodies.face)),
        np.zeros(max(len(bodies.face), 1), np.float32),
        np.empty((3, num_corners)),
        np.empty((5, num_corners)),
        np.empty(num_rings, np.float32),
        np.empty((3, 3)),
    )


@part
def is_aside(bodies: Any, b: int, frames: Float, origins_m: Float, c: int, turn: float, width_m: float) -> Any:
    """Whether a body's box stays out of the column's wedge: of half width `width_m`, widened by the angle `turn`."""
    x, y = bodies.centres_m[0, b] - origins_m[c, 0], bodies.centres_m[1, b] - origins_m[c, 1]
    z = bodies.centres_m[2, b] - origins_m[c, 2]
    aside_m = abs(frames[c, 1, 0] * x + frames[c, 1, 1] * y + frames[c, 1, 2] * z)
    if turn > 0 or width_m > 0:
        aside_m -= width_m + turn * (math.sqrt(x * x + y * y + z * z) + bodies.radii_m[b])
    return aside_m > half_extent_m(bodies.half_axes_m, b, frames[c, 1, 0], frames[c, 1, 1], frames[c, 1, 2])


@finite_loop
def distance_to_planes(bodies: Any, b: int, origins_m: Float, c: int, distance_m: Float) -> float:
    """Writes how far the origin is before each plane of a body; the largest: it is no nearer than that."""
    x, y, z = origins_m[c, 0], origins_m[c, 1], origins_m[c, 2]
    largest_m = -1e300
    for p in range(np.uint64(bodies.plane_start[b]), np.uint64(bodies.plane_start[b + 1])):
        along_m = bodies.normals[0, p] * x + bodies.normals[1, p] * y + bodies.normals[2, p] * z
        distance_m[p] = along_m - bodies.offsets_m[p]
        largest_m = max(largest_m, distance_m[p])
    return largest_m


@finite_loop
def turn_to_group(corners: Float, num: int, cos: float, sin: float, seen: Float) -> tuple[float, float]:
    """Writes a body's corners as seen along a group's azimuth; the extremes of `left` of the first `num`."""
    least, most = 1e300, -1e300
    for i in range(num):
        seen[0, i] = corners[0, i] * cos + corners[1, i] * sin
        seen[1, i] = left = corners[1, i] * cos - corners[0, i] * sin
        seen[2, i] = corners[2, i]
        least, most = min(least, left), max(most, left)
    return least, most


@part
def _draw_body(
    bodies: Any, b: int, table: Any, frames: Float, origins_m: Float, c: int, near_m: float, column: Column
) -> None:
    if is_aside(bodies, b, frames, origins_m, c, table.widest_rad, 0.0):
        return
    is_outside = distance_to_planes(bodies, b, origins_m, c, column.distance_m) > near_m
    start, end = bodies.corner_start[b], bodies.corner_start[b + 1]
    seen_from(bodies.corners_m, start, end, frames, origins_m, c, column.corners)
    reach_m = math.sqrt(distance2(bodies, b, origins_m, c)) + bodies.radii_m[b]
    for g in range(len(table.cos)):
        least, most = turn_to_group(column.corners, end - start, table.cos[g], table.sin[g], column.seen)
        spread = table.spread[g]
        slack_m = spread * reach_m
        if least > slack_m or most < -slack_m:
            continue
        for p in range(bodies.plane_start[b], bodies.plane_start[b + 1]):
            distance_m = column.distance_m[p]
            if abs(distance_m) < _MIN_DISTANCE_M or (is_outside and distance_m < 0):
                continue
            if spread > 0:
                _draw_wide(bodies, b, p, table, g, frames, c, near_m, column)
            else:
                _draw_narrow(bodies, p, table, g, frames, c, near_m, column)


@part
def distance2(bodies: Any, b: int, origins_m: Float, c: int) -> float:
    """The square of how far a body's centre is from the column's origin."""
    square_m2 = 0.0
    for i in range(3):
        square_m2 += (bodies.centres_m[i, b] - origins_m[c, i]) ** 2
    return square_m2


@part
def _draw_narrow(bodies: Any, p: int, table: Any, g: int, frames: Float, c: int, near_m: float, column: Column) -> None:
    """Draws a face into rings of one azimuth."""
    outline = bodies.outline_start[p], bodies.outline_start[p + 1]
    low, high, _, _ = cut(column.seen, 1, bodies.outline_tails, bodies.outline_heads, outline[0], outline[1])
    first, last = rings_between(table, g, low, high)
    if first < last:
        _fill(bodies, p, table, frames, c, near_m, column, first, last)


@part
def _draw_wide(
    bodies: Any, b: int, p: int, table: Any, g: int, frames: Float, c: int, near_m: float, column: Column
) -> None:
    """Draws a face into rings of nearly one azimuth: at its borders each ring is tested against its edges."""
    first_edge, last_edge = bodies.outline_start[p], bodies.outline_start[p + 1]
    tails, heads = bodies.outline_tails, bodies.outline_heads
    where = _side_of_wedge(column.seen, table.spread[g], tails, first_edge, last_edge)
    if where == _ASIDE:
        return
    if where == _ACROSS:
        low, high, slope_low, slope_high = cut(column.seen, 1, tails, heads, first_edge, last_edge)
        low_margin, high_margin = slope_low * table.spread[g] + _MARGIN, slope_high * table.spread[g] + _MARGIN
        low, high, inner_low, inner_high = low - low_margin, high + high_margin, low + low_margin, high - high_margin
    else:
        low, high, inner_low, inner_high = _face_in_wedge(
            column.seen, table.spread[g], tails, heads, first_edge, last_edge
        )
    first, last = rings_between(table, g, low, high)
    inner_first, inner_last = first, last
    while inner_first < last and table.tangent[inner_first] > inner_high:
        inner_first += 1
    while inner_last > inner_first and table.tangent[inner_last - 1] < inner_low:
        inner_last -= 1
    if inner_first < inner_last:
        _fill(bodies, p, table, frames, c, near_m, column, inner_first, inner_last)
    for start, end in ((first, inner_first), (inner_last, last)):
        if start < end:
            _clear_edges(bodies, p, table, column, start, end)
            _fill_clear(bodies, p, table, frames, c, near_m, column, start, end)


@part
def _side_of_wedge(seen: Float, spread: float, tails: Any, first: int, last: int) -> int:
    """Whether an outline lies aside of a wedge, across it with all corners outside, or has corners inside."""
    num_left = num_right = 0
    for e in range(np.uint64(first), np.uint64(last)):
        left, width_m = seen[1, tails[e]], spread * abs(seen[0, tails[e]])
        num_left += left > width_m
        num_right += left < -width_m
    if num_left == last - first or num_right == last - first:
        return _ASIDE
    return _ACROSS if num_left + num_right == last - first else _INSIDE


@part
def _face_in_wedge(seen: Float, spread: float, tails: Any, heads: Any, first: int, last: int) -> Any:
    """`wedge` of one face: `seen` holds the body's corners, of which the face has some."""
    low, high = math.inf, -math.inf
    for e in range(np.uint64(first), np.uint64(last)):
        i = tails[e]
        width_m = spread * seen[0, i]
        seen[3, i], seen[4, i] = seen[1, i] - width_m, seen[1, i] + width_m
        if abs(seen[1, i]) <= abs(width_m):
            elevation = seen[2, i] / seen[0, i] if seen[0, i] > 0 else math.inf
            low, high = min(low, elevation), max(high, elevation)
            if seen[0, i] <= 0:
                low = -math.inf
    low_1, high_1, _, _ = cut(seen, 3, tails, heads, first, last)
    low_2, high_2, _, _ = cut(seen, 4, tails, heads, first, last)
    return (
        min(low, low_1, low_2) - _MARGIN,
        max(high, high_1, high_2) + _MARGIN,
        max(low_1, low_2) + _MARGIN,
        min(high_1, high_2) - _MARGIN,
    )


@loop
def _clear_edges(bodies: Any, p: int, table: Any, column: Column, first: int, last: int) -> None:
    """Writes by how much rays of these rings pass within the outline of a face, seen from the column's origin."""
    corners, clearance, direction = column.corners, column.clearance, table.direction
    sign = -1.0 if column.distance_m[p] > 0 else 1.0
    for i in range(np.uint64(first), np.uint64(last)):
        clearance[i] = np.float32(_TOLERANCE)
    for e in range(np.uint64(bodies.outline_start[p]), np.uint64(bodies.outline_start[p + 1])):
        i, j = bodies.outline_tails[e], bodies.outline_heads[e]
        m_x = corners[1, i] * corners[2, j] - corners[2, i] * corners[1, j]
        m_y = corners[2, i] * corners[0, j] - corners[0, i] * corners[2, j]
        m_z = corners[0, i] * corners[1, j] - corners[1, i] * corners[0, j]
        scale = sign / (abs(m_x) + abs(m_y) + abs(m_z) + 1e-300)
        x, y, z = np.float32(scale * m_x), np.float32(scale * m_y), np.float32(scale * m_z)
        for k in range(np.uint64(first), np.uint64(last)):
            inside = x * direction[0, k] + y * direction[1, k] + z * direction[2, k]
            clearance[k] = inside if inside < clearance[k] else clearance[k]


@loop
def _inverse_ranges(bodies: Any, p: int, frames: Float, c: int, column: Column) -> Any:
    """q with 1 / range = q @ direction, seen from the column."""
    x, y, z = bodies.normals[0, p], bodies.normals[1, p], bodies.normals[2, p]
    scale = -1 / column.distance_m[p]
    column.height_m[p] = abs(column.distance_m[p])
    return (
        np.float32(scale * (frames[c, 0, 0] * x + frames[c, 0, 1] * y + frames[c, 0, 2] * z)),
        np.float32(scale * (frames[c, 1, 0] * x + frames[c, 1, 1] * y + frames[c, 1, 2] * z)),
        np.float32(scale * (frames[c, 2, 0] * x + frames[c, 2, 1] * y + frames[c, 2, 2] * z)),
    )


@loop
def _fill(
    bodies: Any, p: int, table: Any, frames: Float, c: int, near_m: float, column: Column, first: int, last: int
) -> None:
    """Keeps a plane where it is the nearest yet, for rings that surely look at its face."""
    q_x, q_y, q_z = _inverse_ranges(bodies, p, frames, c, column)
    largest = np.float32(1 / near_m) if near_m > 0 else np.float32(np.inf)
    nearest, plane, direction = column.nearest, column.plane, table.direction
    for i in range(np.uint64(first), np.uint64(last)):
        inverse = q_x * direction[0, i] + q_y * direction[1, i] + q_z * direction[2, i]
        is_nearer = (inverse > nearest[i]) & (inverse <= largest)
        nearest[i] = inverse if is_nearer else nearest[i]
        plane[i] = np.int32(p) if is_nearer else plane[i]


@loop
def _fill_clear(
    bodies: Any, p: int, table: Any, frames: Float, c: int, near_m: float, column: Column, first: int, last: int
) -> None:
    """Keeps a plane where it is the nearest yet, for rings that pass within its outline."""
    q_x, q_y, q_z = _inverse_ranges(bodies, p, frames, c, column)
    largest = np.float32(1 / near_m) if near_m > 0 else np.float32(np.inf)
    nearest, plane, direction = column.nearest, column.plane, table.direction
    clearance = column.clearance
    for i in range(np.uint64(first), np.uint64(last)):
        inverse = q_x * direction[0, i] + q_y * direction[1, i] + q_z * direction[2, i]
        is_nearer = (inverse > nearest[i]) & (inverse <= largest) & (clearance[i] >= -np.float32(_TOLERANCE))
        nearest[i] = inverse if is_nearer else nearest[i]
        plane[i] = np.int32(p) if is_nearer else plane[i]


@loop
def _write(bodies: Any, table: Any, column: Column, c: int, range_m: Any, face: Any, cos_incidence: Any) -> None:
    for r in range(len(table.place)):
        i = table.place[r]
        inverse, p = column.nearest[i], column.plane[i]
        is_hit = p >= 0
        p = p if is_hit else np.int32(0)
        cosine = column.height_m[p] * inverse
        cosine = cosine if cosine < 1 else np.float32(1)
        range_m[c, r] = np.float32(1) / inverse if is_hit else np.float32(np.inf)
        face[c, r] = bodies.face[p] if is_hit else np.int32(-1)
        cos_incidence[c, r] = cosine if is_hit else np.float32(0)
