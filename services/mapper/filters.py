"""Thins a scan for registration and map: a range gate, then one point a voxel. The same online and offline."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.mapper.registration import Points
from shared.runtime.config import MapperConfig

_BITS = 21
_OFFSET = 1 << (_BITS - 1)
"""Three signed 21-bit coordinates fit one 64-bit key: at 0.05 m voxels, points within 52 km of the origin."""


def thinned(points_lidar_m: Points, config: MapperConfig) -> NDArray[np.float64]:
    """The scan (N, 3), in the lidar frame, as registration and map take it: (M, 3) in the same frame."""
    near = range_gate(points_lidar_m, config.min_range_m, config.max_range_m)
    return voxel_centroids(near, config.voxel_size_m)


def range_gate(points_m: Points, min_range_m: float, max_range_m: float) -> Points:
    """The points (N, 3) whose distance from their frame's origin is within [min_range_m, max_range_m]."""
    squares = np.einsum("ij,ij->i", points_m, points_m)
    near: Points = points_m[(squares >= min_range_m**2) & (squares <= max_range_m**2)]
    return near


def voxel_keys(points_m: Points, voxel_size_m: float) -> NDArray[np.int64]:
    """One integer (N,) a point, the same for all points of one voxel.

    Raises:
        ValueError: a point is 2^20 voxels or more from the origin.
    """
    cells = np.floor(points_m / voxel_size_m).astype(np.int64)
    if cells.size and np.abs(cells).max() >= _OFFSET:
        raise ValueError(f"points reach {np.abs(points_m).max():.0f} m: too far for voxels of {voxel_size_m} m")
    x, y, z = (cells + _OFFSET).T
    keys: NDArray[np.int64] = (x << 2 * _BITS) | (y << _BITS) | z
    return keys


def voxel_centroids(points_m: Points, voxel_size_m: float) -> NDArray[np.float64]:
    """The mean (M, 3) of the points in each occupied voxel, in the order of the voxels' keys."""
    keys = voxel_keys(points_m, voxel_size_m)
    if not keys.size:
        return np.empty((0, 3))
    order = np.argsort(keys, kind="stable")
    sorted_keys = keys[order]
    starts = np.flatnonzero(np.diff(sorted_keys, prepend=sorted_keys[0] - 1))
    sums = np.add.reduceat(points_m[order].astype(np.float64), starts, axis=0)
    counts = np.diff(starts, append=keys.size)
    centroids: NDArray[np.float64] = sums / counts[:, np.newaxis]
    return centroids
