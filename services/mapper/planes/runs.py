"""Runs: successive points of a scan that lie close together, taken as one with their exact moments.

One look-up in the map serves a whole run, a third of the points' number; what it says of a plane stays exact.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.mapper.planes.moments import NUM_MOMENTS, add_point
from services.mapper.planes.noise import range_bin
from shared.kernel import lean_kernel

Float = NDArray[np.float64]

MAX_RUN_M = 0.07
"""A third of the width of the bars here: most runs lie on one face."""
MAX_RUN_POINTS = 8
_MIN_DIRECTION_M = 0.02
"""A shorter run has no direction that noise would leave recognisable."""


class Runs(NamedTuple):
    """Runs of a scan, in the lidar frame, in the order of measurement.

    centroids_m (R, 3); moments (R, 10) about the lidar; num_points (R,); sigma_m (R,) of a range;
    directions (R, 3) from the first to the last point, 0 where that is too short to say; slopes (R,) in rad: how far
    the direction may be wrong by noise.
    """

    centroids_m: Float
    moments: Float
    num_points: NDArray[np.int64]
    sigma_m: Float
    directions: Float
    slopes: Float


@lean_kernel()
def _set_direction(points_m: NDArray[np.floating], first: int, last: int, sigma_m: float, direction: Float) -> float:
    """Writes the unit direction (3,) of a run, or 0; returns how far it may be wrong."""
    direction[0] = direction[1] = direction[2] = 0.0
    k = last - first + 1
    x = float(points_m[last, 0]) - float(points_m[first, 0])
    y = float(points_m[last, 1]) - float(points_m[first, 1])
    z = float(points_m[last, 2]) - float(points_m[first, 2])
    length = math.sqrt(x * x + y * y + z * z)
    if k < 3 or length < _MIN_DIRECTION_M:
        return 0.0
    direction[0], direction[1], direction[2] = x / length, y / length, z / length
    return sigma_m / length / math.sqrt(k / 3.0)


@lean_kernel()
def _end_of_run(points_m: NDArray[np.floating], first: int) -> int:
    """The index after the last point of the run that begins at `first`."""
    last = min(first + MAX_RUN_POINTS, len(points_m))
    for i in range(first + 1, last):
        x = float(points_m[i, 0]) - float(points_m[first, 0])
        y = float(points_m[i, 1]) - float(points_m[first, 1])
        z = float(points_m[i, 2]) - float(points_m[first, 2])
        if x * x + y * y + z * z > MAX_RUN_M * MAX_RUN_M:
            return i
    return last


@lean_kernel()
def _cut(points_m: NDArray[np.floating], sigma_by_range_m: Float, out: Runs) -> int:
    num, first = 0, 0
    while first < len(points_m):
        after = _end_of_run(points_m, first)
        M = out.moments[num]
        for k in range(NUM_MOMENTS):
            M[k] = 0.0
        for i in range(first, after):
            add_point(M, float(points_m[i, 0]), float(points_m[i, 1]), float(points_m[i, 2]))
        x, y, z = M[3] / M[9], M[6] / M[9], M[8] / M[9]
        out.centroids_m[num, 0], out.centroids_m[num, 1], out.centroids_m[num, 2] = x, y, z
        sigma_m = sigma_by_range_m[range_bin(math.sqrt(x * x + y * y + z * z))]
        out.num_points[num], out.sigma_m[num] = after - first, sigma_m
        out.slopes[num] = _set_direction(points_m, first, after - 1, sigma_m, out.directions[num])
        num, first = num + 1, after
    return num


def cut_runs(points_lidar_m: NDArray[np.floating], sigma_by_range_m: Float) -> Runs:
    """The runs of a scan (N, 3), in the lidar frame. sigma_by_range_m: of `sigma_by_range`."""
    n = len(points_lidar_m)
    out = Runs(
        np.empty((n, 3)), np.empty((n, NUM_MOMENTS)), np.empty(n, np.int64), np.empty(n), np.empty((n, 3)), np.empty(n)
    )
    num = _cut(points_lidar_m, sigma_by_range_m, out)
    return Runs(
        out.centroids_m[:num],
        out.moments[:num],
        out.num_points[:num],
        out.sigma_m[:num],
        out.directions[:num],
        out.slopes[:num],
    )
