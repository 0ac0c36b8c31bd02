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
def span(seen: Float, left: int, tails: Ints, heads: Ints, first: int, last: int) -> Any:
    """Like `cut` of a whole body by its edges; where the axis runs through it the span may be too wide.

    Also whether it is exact.
    """
    low, high = math.inf, -math.inf
    lowest, highest = math.inf, -math.inf
    is_across_axis = False
    for e in range(np.uint64(first), np.uint64(last)):
        i, j = tails[e], heads[e]
        a, b = seen[left, i], seen[left, j]
        if (a > 0) != (b > 0):
            share = a / (a - b)
            x = seen[0, i] + share * (seen[0, j] - seen[0, i])
            z = seen[2, i] + share * (seen[2, j] - seen[2, i])
            lowest, highest = min(lowest, z), max(highest, z)
            if x > 0:
                low, high = min(low, z / x), max(high, z / x)
            else:
                is_across_axis = True
    if low > high or not is_across_axis:
        return low, high, True
    if highest < 0:
        return -math.inf, high, True
    if lowest > 0:
        return low, math.inf, True
    return -math.inf, math.inf, False


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


@part
def wedge(seen: Float, num: int, slab: Any, tails: Ints, heads: Ints, first: int, last: int) -> Any:
    """Outer and inner (low, high) of a convex body in the wedge |left| <= slab[0] + slab[1] * outward.

    Whatever of the body is in the wedge lies between the outer elevations; between the inner ones it fills the wedge
    from side to side. seen (5, n): of its corners; rows 3 and 4 are written to. The edges are those from `first` on.
    """
    low, high = math.inf, -math.inf
    for i in range(num):
        width_m = slab[0] + slab[1] * seen[0, i]
        seen[3, i], seen[4, i] = seen[1, i] - width_m, seen[1, i] + width_m
        if abs(seen[1, i]) <= width_m:
            elevation = seen[2, i] / seen[0, i]
            low = min(low, elevation) if seen[0, i] > 0 else -math.inf
            high = max(high, elevation) if seen[0, i] > 0 else math.inf
    low_1, high_1, is_exact_1 = span(seen, 3, tails, heads, first, last)
    low_2, high_2, is_exact_2 = span(seen, 4, tails, heads, first, last)
    low, high = min(low, low_1, low_2), max(high, high_1, high_2)
    if not (is_exact_1 and is_exact_2):
        return low, high, math.inf, -math.inf
    return low, high, max(low_1, low_2), min(high_1, high_2)


@part
def higher(tangent: float, by: float) -> float:
    """The tangent of an elevation raised by an angle of tangent `by`; inf from straight up on."""
    if math.isinf(tangent) or tangent * by >= 1:
        return tangent if math.isinf(tangent) else math.inf
    return (tangent + by) / (1 - tangent * by)
