"""Depth images to points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shared.kernel import kernel


@kernel()
def points_of(
    depth_mm: NDArray[np.uint16], fx: float, fy: float, cx: float, cy: float, stride: int = 1
) -> NDArray[np.float32]:
    """The points (N, 3) in the optical frame of the pixels (H, W) that have a depth, row by row.

    stride: only every so many rows and columns.
    """
    height, width = depth_mm.shape
    points_m = np.empty((np.count_nonzero(depth_mm[::stride, ::stride]), 3), dtype=np.float32)
    column_slopes = ((np.arange(width) - cx) / fx).astype(np.float32)
    n = 0
    for v in range(0, height, stride):
        row_slope = np.float32((v - cy) / fy)
        for u in range(0, width, stride):
            if depth_mm[v, u] > 0:
                z = np.float32(0.001) * np.float32(depth_mm[v, u])
                points_m[n, 0], points_m[n, 1], points_m[n, 2] = z * column_slopes[u], z * row_slope, z
                n += 1
    return points_m
