"""Half-planes through a LiDAR's axis against convex bodies: where they cut, and which rings look there.

Points are seen from where a column's beams begin: outward, to the left, up. Elevations are given as tangents.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from services.sensors.rays.kernels import part

Float = NDArray[np.float64]
Ints = NDArray[np.int32]

_TOLERANCE = 1e-9
"""Faces reach beyond their edges by this much, so that no ray slips between two."""


@part
def seen_from(corners_m: Float, first: int, last: int, frames: Float, origins_m: Float, c: int, out: Float) -> None:
    """Writes corners_m[:, first:last] as column c sees them, by its frame (axes as rows) and origin, into out."""
    x, y, z = origins_m[c, 0], origins_m[c, 1], origins_m[c, 2]
    for k in range(3):
        a, b, d = frames[c, k, 0], frames[c, k, 1], frames[c, k, 2]
        for i in range(last - first):
            j = np.uint64(first + i)
            out[k, i] = a * (corners_m[0, j] - x) + b * (corners_m[1, j] - y) + d * (corners_m[2, j] - z)


@part
def cut(seen: Float, left: int, tails: Ints, heads: Ints, first: int, last: int) -> Any:
    """Between which elevations the half-plane seen[left] = 0 cuts a polygon; (inf, -inf) if not at all.

    Also by how much these two change with the azimuth.
    seen (5, n): of each corner outward, left and up, and two rows of other distances to the left.
    """
    num = 0
    i0 = j0 = i1 = j1 = np.uint32(0)
    for e in range(np.uint64(first), np.uint64(last)):
        i, j = tails[e], heads[e]
        if (seen[left, i] > 0) != (seen[left, j] > 0):
            i0, j0, i1, j1 = i1, j1, i, j
            num += 1
    if num < 2:
        return math.inf, -math.inf, 0.0, 0.0
    x0, z0, slope0 = _crossing(seen, left, i0, j0)
    x1, z1, slope1 = _crossing(seen, left, i1, j1)
    if x0 > 0 and x1 > 0:
        t0, t1 = z0 / x0, z1 / x1
        return (t0, t1, slope0, slope1) if t0 < t1 else (t1, t0, slope1, slope0)
    low, high = _between(x0, z0, x1, z1)
    slope = slope0 if x0 > 0 else slope1
    return low, high, slope, slope


@part
def _crossing(seen: Float, left: int, i: Any, j: Any) -> Any:
    """Where an edge crosses a half-plane: outward, up, and by how much the elevation changes with the azimuth."""
    share = seen[left, i] / (seen[left, i] - seen[left, j])
    x, z = seen[0, j] - seen[0, i], seen[2, j] - seen[2, i]
    m_y, m_z = seen[2, i] * x - seen[0, i] * z, seen[0, i] * seen[1, j] - seen[1, i] * seen[0, j]
    return seen[0, i] + share * x, seen[2, i] + share * z, abs(m_y / m_z)


@part
def _between(x0: float, z0: float, x1: float, z1: float) -> tuple[float, float]:
    """The elevations of those points of a segment that have x > 0, of which not both ends do."""
    if x0 <= 0 and x1 <= 0:
        return math.inf, -math.inf
    elevation = z0 / x0 if x0 > 0 else z1 / x1
    z_on_axis = z0 + x0 / (x0 - x1) * (z1 - z0)
    return (elevation, math.inf) if z_on_axis > 0 else (-math.inf, elevation)


@part
def rings_between(table: Any, group: int, low: float, high: float) -> tuple[int, int]:
    """The rings of a group that look between two elevations: the first, and the one behind the last."""
    if low > high:
        return 0, 0
    first = _first_at_or_below(table, group, high + _TOLERANCE * (1 + abs(high)))
    return first, max(first, _first_at_or_below(table, group, low - _TOLERANCE * (1 + abs(low))))


@part
def _first_at_or_below(table: Any, group: int, tangent: float) -> Any:
    start, end = table.start[group], table.start[group + 1]
    if tangent >= table.tangent[start]:
        return start
    if not tangent >= table.tangent[end - 1]:
        return end
    bin_number = int((table.tangent_top[group] - tangent) * table.bins_per_tangent[group])
    i = table.bins[group, min(bin_number, table.bins.shape[1] - 1)]
    while i > start and table.tangent[i - 1] <= tangent:
        i -= 1
    while i < end and table.tangent[i] > tangent:
        i += 1
    return i
