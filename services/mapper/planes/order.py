"""Scans in no order are put in one, so that runs can be cut: neighbours in space become neighbours in the list."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.mapper.planes.voxel_table import voxel_key
from shared.kernel import kernel

_CELL_M = 0.04
"""Its diagonal is the longest run."""
_NEAR_M = 0.2
_ORDERED_SHARE = 0.3
"""Of successive points, more are near one another in any order of measurement; in a shuffled one a few in 100."""


@kernel()
def _share_near(points_m: NDArray[np.floating], stride: int) -> float:
    near, num = 0, 0
    for i in range(1, len(points_m), stride):
        x, y, z = (
            points_m[i, 0] - points_m[i - 1, 0],
            points_m[i, 1] - points_m[i - 1, 1],
            points_m[i, 2] - points_m[i - 1, 2],
        )
        near += x * x + y * y + z * z < _NEAR_M * _NEAR_M
        num += 1
    return near / max(num, 1)


@kernel()
def _keys(points_m: NDArray[np.floating]) -> NDArray[np.int64]:
    keys = np.empty(len(points_m), np.int64)
    for i in range(len(points_m)):
        keys[i] = voxel_key(float(points_m[i, 0]), float(points_m[i, 1]), float(points_m[i, 2]), 1.0 / _CELL_M)
    return keys


def in_order(points_lidar_m: NDArray[np.floating]) -> NDArray[np.floating]:
    """The scan (N, 3) itself if its order is one of measurement; else sorted by small cells."""
    if len(points_lidar_m) < 2 or _share_near(points_lidar_m, 4) > _ORDERED_SHARE:
        return points_lidar_m
    ordered: NDArray[np.floating] = points_lidar_m[np.argsort(_keys(points_lidar_m), kind="stable")]
    return ordered
