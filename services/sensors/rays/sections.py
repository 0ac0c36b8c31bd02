"""Half-planes through a LiDAR's axis against convex bodies: where they cut, and which rings look there.

Points are seen from where a column's beams begin: outward, to the left, up. Elevations are given as tangents.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

Float = NDArray[np.float64]
Ints = NDArray[np.int32]

_TOLERANCE = 1e-9
"""Faces reach beyond their edges by this much, so that no ray slips between two."""


@njit(cache=True)
def seen_from(corners_m: Float, frame: Float, origin_m: Float, out: Float) -> None:
    """Writes corners (n, 3) as a column with that frame (its axes as rows) and origin sees them, into out[:, :n]."""
    for i in range(len(corners_m)):
        x, y, z = corners_m[i, 0] - origin_m[0], corners_m[i, 1] - origin_m[1], corners_m[i, 2] - origin_m[2]
        for k in range(3):
            out[k, i] = frame[k, 0] * x + frame[k, 1] * y + frame[k, 2] * z


@njit(cache=True)
def cut(outward: Float, left: Float, up: Float, tails: Ints, heads: Ints, first: int, last: int) -> tuple[float, float]:
    """Between which elevations the half-plane left = 0 cuts a convex polygon, exactly; (inf, -inf) if not at all."""
    num = 0
    x0 = z0 = x1 = z1 = 0.0
    for e in range(first, last):
        i, j = tails[e], heads[e]
        if (left[i] > 0) != (left[j] > 0):
            share = left[i] / (left[i] - left[j])
            x0, z0 = x1, z1
            x1, z1 = outward[i] + share * (outward[j] - outward[i]), up[i] + share * (up[j] - up[i])
            num += 1
    if num < 2:
        return math.inf, -math.inf
    return _between(x0, z0, x1, z1)


@njit(cache=True)
def _between(x0: float, z0: float, x1: float, z1: float) -> tuple[float, float]:
    """The elevations of a segment's points with x > 0."""
    if x0 > 0 and x1 > 0:
        return min(z0 / x0, z1 / x1), max(z0 / x0, z1 / x1)
    if x0 <= 0 and x1 <= 0:
        return math.inf, -math.inf
    elevation = z0 / x0 if x0 > 0 else z1 / x1
    z_on_axis = z0 + x0 / (x0 - x1) * (z1 - z0)
    return (elevation, math.inf) if z_on_axis > 0 else (-math.inf, elevation)


@njit(cache=True)
def span(outward: Float, left: Float, up: Float, tails: Ints, heads: Ints, first: int, last: int) -> Any:
    """Like `cut` of a whole body by its edges; where the axis runs through it the span may be too wide.

    Also whether it is exact.
    """
    low, high = math.inf, -math.inf
    lowest, highest = math.inf, -math.inf
    is_across_axis = False
    for e in range(first, last):
        i, j = tails[e], heads[e]
        if (left[i] > 0) != (left[j] > 0):
            share = left[i] / (left[i] - left[j])
            x, z = outward[i] + share * (outward[j] - outward[i]), up[i] + share * (up[j] - up[i])
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


@njit(cache=True)
def within(outward: Float, left: Float, up: Float, num: int, slab: Any) -> tuple[float, float]:
    """Between which elevations those corners lie that are in the wedge |left| <= slab[0] + slab[1] * outward."""
    low, high = math.inf, -math.inf
    for i in range(num):
        if abs(left[i]) <= slab[0] + slab[1] * outward[i]:
            if outward[i] <= 0:
                return -math.inf, math.inf
            low, high = min(low, up[i] / outward[i]), max(high, up[i] / outward[i])
    return low, high


@njit(cache=True)
def wedge(seen: Any, slab: Any, tails: Ints, heads: Ints, first: int, last: int, num_corners: int) -> Any:
    """Outer and inner (low, high) of a convex outline or body in the wedge |left| <= slab[0] + slab[1] * outward.

    Whatever of it is in the wedge lies between the outer elevations; between the inner ones it fills the wedge from
    side to side. seen: outward, left, up and two arrays to write to.
    """
    outward, left, up, one, other = seen
    for i in range(num_corners):
        width_m = slab[0] + slab[1] * outward[i]
        one[i], other[i] = left[i] - width_m, left[i] + width_m
    low, high = within(outward, left, up, num_corners, slab)
    low_1, high_1, is_exact_1 = span(outward, one, up, tails, heads, first, last)
    low_2, high_2, is_exact_2 = span(outward, other, up, tails, heads, first, last)
    low, high = min(low, low_1, low_2), max(high, high_1, high_2)
    if not (is_exact_1 and is_exact_2):
        return low, high, math.inf, -math.inf
    return low, high, max(low_1, low_2), min(high_1, high_2)


@njit(cache=True)
def rings_between(table: Any, group: int, low: float, high: float) -> tuple[int, int]:
    """The rings of a group that look between two elevations: the first, and the one behind the last."""
    if low > high:
        return 0, 0
    first = _first_at_or_below(table, group, high + _TOLERANCE * (1 + abs(high)))
    return first, max(first, _first_at_or_below(table, group, low - _TOLERANCE * (1 + abs(low))))


@njit(cache=True)
def _first_at_or_below(table: Any, group: int, tangent: float) -> int:
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
