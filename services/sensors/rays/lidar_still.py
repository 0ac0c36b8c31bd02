"""A scan from a sensor at rest, its beams in even columns through one point: face after face.

A column is a half-plane through the axis. Where it cuts an edge P-Q, the elevation's tangent is
-(m_x cos a + m_y sin a) / m_z with m = P x Q, a the column's azimuth: nothing to divide within the loop.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.sensors.rays.bodies import Bodies
from services.sensors.rays.kernels import kernel, loop, part
from services.sensors.rays.lidar_moving import distance_to_planes, turn_to_group
from services.sensors.rays.ring_table import RingTable
from services.sensors.rays.sections import cut, rings_between, seen_from

Float = NDArray[np.float64]

_WIDE = 0.45
"""Faces across more of a turn than this, and those around the axis, are cut column by column."""
_UPRIGHT = 1e-9
"""An edge that spans less of an angle is met at one of its ends."""
_MIN_DISTANCE_M = 1e-9
"""A face whose plane the sensor is in is not met."""


class Grid(NamedTuple):
    """What is drawn on, and room to work in.

    first_rad: azimuth of column 0. cos, sin (2 C,): of the columns' azimuths, two turns long. flat, rise (R,): of the
    rings' directions. distance_m (P,): of the beams' origin from each plane. corners (3, n), seen (5, n): of the body
    at hand. column (n,): where the axis sees each corner, in columns. unwound (m + 1,): the same along an outline,
    without jumps. low, high (C,): elevations between which a face lies in each column. face, height_m (P + 1,): what
    the rays get, by plane, the first for those that meet none.
    """

    first_rad: float
    cos: Float
    sin: Float
    flat: NDArray[np.float32]
    rise: NDArray[np.float32]
    distance_m: Float
    corners: Float
    seen: Float
    column: Float
    unwound: Float
    low: Float
    high: Float
    face: NDArray[np.int32]
    height_m: NDArray[np.float32]


@kernel
def scan_still(
    bodies: Any, table: Any, frame: Float, origin_m: Float, near_m: float, far_m: float, hits: Any, grid: Any
) -> None:
    """Writes range_m, face, cos_incidence (C, R), the arrays of `hits`; table: of one group without spread.

    frame (3, 3): the axes in which the beams turn, as rows.
    """
    frames, origins_m = frame.reshape(1, 3, 3), origin_m.reshape(1, 3)
    nearest, plane = hits[0], hits[1]
    nearest[:] = 1 / far_m
    plane[:] = -1
    for b in range(len(bodies.radii_m)):
        if _is_out_of_view(bodies, b, table, frame, origin_m, far_m):
            continue
        is_outside = distance_to_planes(bodies, b, origins_m, 0, grid.distance_m) > near_m
        start, end = bodies.corner_start[b], bodies.corner_start[b + 1]
        seen_from(bodies.corners_m, start, end, frames, origins_m, 0, grid.corners)
        for i in range(end - start):
            azimuth = math.atan2(grid.corners[1, i], grid.corners[0, i])
            grid.column[i] = (grid.first_rad - azimuth) * len(grid.low) / (2 * math.pi)
        for p in range(bodies.plane_start[b], bodies.plane_start[b + 1]):
            distance_m = grid.distance_m[p]
            if abs(distance_m) >= _MIN_DISTANCE_M and not (is_outside and distance_m < 0):
                _draw_face(bodies, b, p, table, frame, distance_m, near_m, nearest, plane, grid)
    _finish(bodies, nearest.reshape(-1), plane.reshape(-1), hits[2].reshape(-1), grid)


def grid_for(bodies: Bodies, table: RingTable, num_columns: int, first_rad: float) -> Grid:
    """Room for scans of so many columns. first_rad: azimuth of column 0; they go clockwise."""
    num_corners = int(np.diff(bodies.corner_start).max(initial=0))
    azimuth = first_rad - 2 * math.pi / num_columns * np.arange(2 * num_columns)
    return Grid(
        first_rad,
        np.cos(azimuth),
        np.sin(azimuth),
        np.hypot(table.direction[0], table.direction[1]),
        table.direction[2],
        np.empty(len(bodies.face)),
        np.empty((3, num_corners)),
        np.empty((5, num_corners)),
        np.empty(num_corners),
        np.empty(int(np.diff(bodies.outline_start).max(initial=0)) + 1),
        np.empty(num_columns),
        np.empty(num_columns),
        np.empty(len(bodies.face) + 1, np.int32),
        np.empty(len(bodies.face) + 1, np.float32),
    )


@part
def _is_out_of_view(bodies: Any, b: int, table: Any, frame: Float, origin_m: Float, far_m: float) -> Any:
    """Whether a body's ball lies beyond the range, or wholly above or below the beams."""
    x, y = bodies.centres_m[0, b] - origin_m[0], bodies.centres_m[1, b] - origin_m[1]
    z = bodies.centres_m[2, b] - origin_m[2]
    square_m2, radius_m = x * x + y * y + z * z, bodies.radii_m[b]
    if math.sqrt(square_m2) - radius_m > far_m:
        return True
    height_m = frame[2, 0] * x + frame[2, 1] * y + frame[2, 2] * z
    aside_m = math.sqrt(max(square_m2 - height_m * height_m, 0.0))
    above_m = math.cos(table.top_rad) * height_m - math.sin(table.top_rad) * aside_m
    below_m = math.sin(table.bottom_rad) * aside_m - math.cos(table.bottom_rad) * height_m
    return max(above_m, below_m) > radius_m


@part
def _draw_face(
    bodies: Any,
    b: int,
    p: int,
    table: Any,
    frame: Float,
    distance_m: float,
    near_m: float,
    nearest: Any,
    plane: Any,
    grid: Grid,
) -> None:
    outline = bodies.outline_start[p], bodies.outline_start[p + 1]
    if outline[0] == outline[1]:
        return
    least, most, is_wide = _unwind(bodies.outline_tails, outline[0], outline[1], grid)
    if is_wide:
        first, num = 0, len(grid.low)
        _cut_columns(bodies, b, outline[0], outline[1], grid)
    else:
        first, num = math.ceil(least), math.ceil(most) - math.ceil(least)
        first -= first // len(grid.low) * len(grid.low)
        _cut_edges(bodies, outline[0], outline[1], first - math.ceil(least), math.ceil(least), num, grid)
    q_x, q_y, q_z = _inverse_ranges(frame, bodies.normals[:, p], distance_m)
    largest = np.float32(1 / near_m) if near_m > 0 else np.float32(np.inf)
    for k in range(num):
        low, high = rings_between(table, 0, grid.low[k], grid.high[k])
        if low < high:
            c = first + k
            a = np.float32(q_x * grid.cos[c] + q_y * grid.sin[c])
            c -= len(grid.low) if c >= len(grid.low) else 0
            _fill(nearest[c], plane[c], grid.flat, grid.rise, a, np.float32(q_z), largest, p, low, high)


@part
def _inverse_ranges(frame: Float, normal: Float, distance_m: float) -> tuple[float, float, float]:
    """q with 1 / range = q @ direction, in the frame's axes."""
    n_x, n_y, n_z = normal[0], normal[1], normal[2]
    scale = -1 / distance_m
    return (
        scale * (frame[0, 0] * n_x + frame[0, 1] * n_y + frame[0, 2] * n_z),
        scale * (frame[1, 0] * n_x + frame[1, 1] * n_y + frame[1, 2] * n_z),
        scale * (frame[2, 0] * n_x + frame[2, 1] * n_y + frame[2, 2] * n_z),
    )


@part
def _unwind(tails: Any, first: int, last: int, grid: Grid) -> tuple[float, float, bool]:
    """Writes where an outline's corners are seen, in columns without jumps; least, most, and whether it is wide."""
    num_columns = len(grid.low)
    here = least = most = grid.column[tails[first]]
    grid.unwound[0] = here
    widest = 0.0
    for e in range(first + 1, last + 1):
        there = grid.column[tails[e if e < last else first]]
        there += round((here - there) / num_columns) * num_columns
        widest = max(widest, abs(there - here))
        grid.unwound[e - first] = here = there
        least, most = min(least, here), max(most, here)
    is_around_axis = abs(here - grid.unwound[0]) > num_columns / 2
    return least, most, is_around_axis or most - least > _WIDE * num_columns


@part
def _cut_columns(bodies: Any, b: int, first: int, last: int, grid: Grid) -> None:
    num = bodies.corner_start[b + 1] - bodies.corner_start[b]
    seen = grid.seen
    for c in range(len(grid.low)):
        turn_to_group(grid.corners, num, grid.cos[c], grid.sin[c], seen)
        grid.low[c], grid.high[c], _, _ = cut(seen, 1, bodies.outline_tails, bodies.outline_heads, first, last)


@part
def _cut_edges(bodies: Any, first: int, last: int, shift: int, first_column: int, num: int, grid: Grid) -> None:
    """Writes low and high of `num` columns; `shift` leads from unwound columns to those of cos and sin."""
    grid.low[:num] = np.inf
    grid.high[:num] = -np.inf
    x, y, z = grid.corners
    for e in range(first, last):
        i, j = bodies.outline_tails[e], bodies.outline_heads[e]
        start, end = grid.unwound[e - first], grid.unwound[e - first + 1]
        m_z = x[i] * y[j] - y[i] * x[j]
        if abs(m_z) > _UPRIGHT * (abs(x[i]) + abs(y[i])) * (abs(x[j]) + abs(y[j])):
            t_x, t_y = -(y[i] * z[j] - z[i] * y[j]) / m_z, -(z[i] * x[j] - x[i] * z[j]) / m_z
            a, b = math.ceil(min(start, end)) + shift, math.ceil(max(start, end)) + shift
            k = first_column + shift
            _bound(grid.low[a - k : b - k], grid.high[a - k : b - k], grid.cos[a:b], grid.sin[a:b], t_x, t_y)
        elif math.ceil(start) != math.ceil(end):
            k, tangent = math.ceil(min(start, end)) - first_column, z[i] / math.hypot(x[i], y[i])
            grid.low[k], grid.high[k] = min(grid.low[k], tangent), max(grid.high[k], tangent)


@part
def _bound(low: Float, high: Float, cos: Float, sin: Float, t_x: float, t_y: float) -> None:
    for c in range(len(low)):
        tangent = t_x * cos[c] + t_y * sin[c]
        low[c] = tangent if tangent < low[c] else low[c]
        high[c] = tangent if tangent > high[c] else high[c]


@loop
def _fill(
    nearest: Any, plane: Any, flat: Any, rise: Any, a: Any, b: Any, largest: Any, p: int, first: int, last: int
) -> None:
    for r in range(np.uint64(first), np.uint64(last)):
        inverse = a * flat[r] + b * rise[r]
        is_nearer = (inverse > nearest[r]) & (inverse <= largest)
        nearest[r] = inverse if is_nearer else nearest[r]
        plane[r] = np.int32(p) if is_nearer else plane[r]


@loop
def _finish(bodies: Any, nearest: Any, plane: Any, cos_incidence: Any, grid: Grid) -> None:
    """Turns inverses into ranges, and planes into faces."""
    face, height_m = grid.face, grid.height_m
    face[0], height_m[0] = -1, 0
    for p in range(len(grid.distance_m)):
        face[p + 1], height_m[p + 1] = bodies.face[p], abs(grid.distance_m[p])
    for i in range(len(nearest)):
        k, inverse = plane[i] + 1, nearest[i]
        cosine = height_m[k] * inverse
        cos_incidence[i] = cosine if cosine < 1 else np.float32(1)
        nearest[i] = np.float32(1) / inverse if k > 0 else np.float32(np.inf)
        plane[i] = face[k]
