"""Which bodies a few neighbouring columns of a scan may meet at all."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from services.sensors.rays.kernels import kernel, part

Float = NDArray[np.float64]


@part
def half_extent_m(half_axes_m: Float, b: int, x: float, y: float, z: float) -> float:
    """How far a box reaches from its centre along a vector."""
    reach = 0.0
    for i in range(3):
        reach += abs(half_axes_m[b, 0, i] * x + half_axes_m[b, 1, i] * y + half_axes_m[b, 2, i] * z)
    return reach


@kernel
def candidates_of(
    bodies: Any,
    table: Any,
    frames: Float,
    origins_m: Float,
    reach: tuple[float, float],
    far_m: float,
    walls: Any,
    found: Any,
) -> int:
    """Writes into `found` the bodies that the columns of these frames may meet, and says how many.

    frames (n, 3, 3): outward, left, up as rows; origins_m (n, 3). reach: by how much a beam is wider than a line at
    its start, and how much it widens with each metre. walls (3, 3): room for planes that bound the beams.
    """
    middle = len(frames) // 2
    out, left, up = frames[middle, 0], frames[middle, 1], frames[middle, 2]
    turn, shift_m = turn_and_shift(frames, origins_m, middle)
    steeper = 1.5 * turn + reach[1] + 1 - math.cos(table.widest_rad)
    turn += table.widest_rad + reach[1]
    for i in range(3):
        walls[0, i] = -out[i]
        walls[1, i] = math.cos(table.top_rad) * up[i] - math.sin(table.top_rad) * out[i]
        walls[2, i] = math.sin(table.bottom_rad) * out[i] - math.cos(table.bottom_rad) * up[i]
    num = 0
    for b in range(len(bodies.radii_m)):
        x = bodies.centres_m[0, b] - origins_m[middle, 0]
        y = bodies.centres_m[1, b] - origins_m[middle, 1]
        z = bodies.centres_m[2, b] - origins_m[middle, 2]
        radius_m = bodies.radii_m[b]
        end_m = math.sqrt(x * x + y * y + z * z) + radius_m
        aside_m = abs(left[0] * x + left[1] * y + left[2] * z) - turn * end_m - shift_m - reach[0]
        if aside_m > radius_m or end_m - 2 * radius_m > far_m + shift_m + reach[0]:
            continue
        if aside_m > half_extent_m(bodies.half_axes_m, b, left[0], left[1], left[2]):
            continue
        if not _is_beyond(walls, bodies.half_axes_m, b, x, y, z, steeper * end_m + shift_m + reach[0]):
            found[num] = b
            num += 1
    return num


@part
def turn_and_shift(frames: Float, origins_m: Float, middle: int) -> tuple[float, float]:
    """By how much any axis of any frame differs from the middle one's, and any origin."""
    turn, shift_m = 0.0, 0.0
    for c in range(len(frames)):
        for i in range(3):
            turn = max(turn, _square(frames[c, i], frames[middle, i]))
        shift_m = max(shift_m, _square(origins_m[c], origins_m[middle]))
    return math.sqrt(turn), math.sqrt(shift_m)


@part
def _is_beyond(walls: Float, half_axes_m: Float, b: int, x: float, y: float, z: float, slack_m: float) -> bool:
    """Whether the box lies wholly on the outer side of a plane through the origin."""
    for i in range(3):
        nearest_m = walls[i, 0] * x + walls[i, 1] * y + walls[i, 2] * z - slack_m
        if nearest_m > 0 and nearest_m > half_extent_m(half_axes_m, b, walls[i, 0], walls[i, 1], walls[i, 2]):
            return True
    return False


@part
def _square(a: Float, b: Float) -> Any:
    return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2
