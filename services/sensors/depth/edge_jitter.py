"""Outlines that are not quite where they should be: near a step in depth, pixels take the depth of a pixel beside."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.sensors.depth.correlated import Float32, Spline, at_pixel
from services.sensors.kernel import kernel

BLOCK_PX = 8
_MOST_SIGMAS = 4.0
_LEAST_STEP = np.float32(0.05)
"""A step between two depths is more than this share of the greater: a surface seen at 75 degrees has 0.6 % a pixel."""


@kernel()
def edge_blocks(face: NDArray[np.int32], jitter_px: np.float32) -> NDArray[np.bool_]:
    """Which blocks of 8 x 8 pixels have another face within reach of the displacements."""
    height, width = face.shape
    borders = np.zeros(((height + BLOCK_PX - 1) // BLOCK_PX, (width + BLOCK_PX - 1) // BLOCK_PX), dtype=np.bool_)
    for v in range(height):
        _mark_changes(face[v], face[max(v - 1, 0)], borders[v // BLOCK_PX])
    reach = int(np.ceil(_MOST_SIGMAS * jitter_px / BLOCK_PX))
    near = np.zeros_like(borders)
    for i in range(borders.shape[0]):
        for j in range(borders.shape[1]):
            if borders[i, j]:
                near[max(i - reach, 0) : i + reach + 1, max(j - reach, 0) : j + reach + 1] = True
    return near


@kernel()
def _mark_changes(row: NDArray[np.int32], above: NDArray[np.int32], borders: NDArray[np.bool_]) -> None:
    """Marks the blocks in which a pixel's face is another than that of the one before or above it."""
    width = len(row)
    for block in range(width // BLOCK_PX):
        start = block * BLOCK_PX
        before = max(start - 1, 0)
        changes = (row[start] ^ row[before]) | (row[start] ^ above[start])
        for i in range(1, BLOCK_PX):
            u = start + i
            changes |= (row[u] ^ row[u - 1]) | (row[u] ^ above[u])
        borders[block] |= changes != 0
    for u in range(width // BLOCK_PX * BLOCK_PX, width):
        borders[u // BLOCK_PX] |= row[u] != row[max(u - 1, 0)] or row[u] != above[u]


@kernel()
def jitter_row(
    depth_m: Float32,
    cos_incidence: Float32,
    v: int,
    is_edge: NDArray[np.bool_],
    displacements: tuple[Float32, Float32, np.float32],
    spline: Spline,
    row_m: Float32,
    row_cos: Float32,
) -> None:
    """Displaces row v of the image within the blocks (of this row) that are near edges.

    displacements: knot rows of those to the right and downwards, and their standard deviation in pixels. row_m, row_cos
    (W,): the row, changed in place.
    """
    height, width = depth_m.shape
    right_rows, down_rows, jitter_px = displacements
    most = np.float32(_MOST_SIGMAS)
    for block in range(len(is_edge)):
        if not is_edge[block]:
            continue
        for u in range(block * BLOCK_PX, min((block + 1) * BLOCK_PX, width)):
            right = min(max(at_pixel(right_rows, spline, v, u), -most), most)
            down = min(max(at_pixel(down_rows, spline, v, u), -most), most)
            from_u = min(max(int(np.rint(u + jitter_px * right)), 0), width - 1)
            from_v = min(max(int(np.rint(v + jitter_px * down)), 0), height - 1)
            if _is_step(depth_m[v, u], depth_m[from_v, from_u]):
                row_m[u], row_cos[u] = depth_m[from_v, from_u], cos_incidence[from_v, from_u]


@kernel(inline="always")
def _is_step(a_m: np.float32, b_m: np.float32) -> bool:
    return bool(min(a_m, b_m) < (np.float32(1.0) - _LEAST_STEP) * max(a_m, b_m))
