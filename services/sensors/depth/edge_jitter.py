"""Outlines that are not quite where they should be: near a step in depth, pixels take the depth of a pixel beside."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.sensors.depth.correlated import Float32, Spline, add_row
from shared.kernel import kernel

BLOCK_PX = 8
MOST_SIGMAS = 4.0
_LEAST_STEP = np.float32(0.05)
"""A step between two depths is more than this share of the greater: a surface seen at 75 degrees has 0.6 % a pixel."""


@kernel()
def edge_blocks(depth_m: Float32, jitter_px: np.float32) -> NDArray[np.bool_]:
    """Which blocks of 8 x 8 pixels have a step in depth within reach of the displacements."""
    height, width = depth_m.shape
    steps = np.zeros(((height + BLOCK_PX - 1) // BLOCK_PX, (width + BLOCK_PX - 1) // BLOCK_PX), dtype=np.bool_)
    if jitter_px == 0.0:
        return steps
    is_step = np.empty(width, dtype=np.bool_)
    for v in range(height):
        _mark_steps(depth_m[v], depth_m[max(v - 1, 0)], is_step, steps[v // BLOCK_PX])
    reach = int(np.ceil(MOST_SIGMAS * jitter_px / BLOCK_PX))
    near = np.zeros_like(steps)
    for i in range(steps.shape[0]):
        for j in range(steps.shape[1]):
            if steps[i, j]:
                near[max(i - reach, 0) : i + reach + 1, max(j - reach, 0) : j + reach + 1] = True
    return near


@kernel()
def _mark_steps(row_m: Float32, above_m: Float32, is_step: NDArray[np.bool_], steps: NDArray[np.bool_]) -> None:
    """Marks the blocks in which there is a step from a pixel to the one before or above it. is_step (W,) is scratch."""
    is_step[0] = _is_step(row_m[0], above_m[0])
    for u in range(1, len(row_m)):
        is_step[u] = _is_step(row_m[u], row_m[u - 1]) | _is_step(row_m[u], above_m[u])
    for block in range(len(steps)):
        steps[block] |= is_step[block * BLOCK_PX : (block + 1) * BLOCK_PX].any()


@kernel()
def jitter_row(
    depth_m: Float32,
    cos_incidence: Float32,
    v: int,
    is_edge: NDArray[np.bool_],
    displacements_px: Float32,
    row_m: Float32,
    row_cos: Float32,
) -> None:
    """Displaces row v of the image within those of its blocks that are near edges.

    displacements_px (2, W): of the row's pixels to the right and downwards. row_m, row_cos (W,): the row, changed in
    place.
    """
    height, width = depth_m.shape
    right, down = displacements_px[0], displacements_px[1]
    for block in range(len(is_edge)):
        if not is_edge[block]:
            continue
        for u in range(block * BLOCK_PX, min((block + 1) * BLOCK_PX, width)):
            from_u = min(max(u + int(np.rint(right[u])), 0), width - 1)
            from_v = min(max(v + int(np.rint(down[u])), 0), height - 1)
            if _is_step(depth_m[v, u], depth_m[from_v, from_u]):
                row_m[u], row_cos[u] = depth_m[from_v, from_u], cos_incidence[from_v, from_u]


@kernel()
def displace_row(
    rows: tuple[Float32, Float32], spline: Spline, v: int, jitter_px: np.float32, displacements_px: Float32
) -> None:
    """The displacements (2, W) of row v's pixels, within 4 standard deviations. rows: knot rows of both."""
    displacements_px[:] = np.float32(0.0)
    most_px = np.float32(MOST_SIGMAS) * jitter_px
    for axis in range(2):
        values = displacements_px[axis]
        add_row(rows[axis], spline, v, jitter_px, values)
        for u in range(len(values)):
            values[u] = min(max(values[u], -most_px), most_px)


@kernel(inline="always")
def _is_step(a_m: np.float32, b_m: np.float32) -> bool:
    return bool(min(a_m, b_m) < (np.float32(1.0) - _LEAST_STEP) * max(a_m, b_m))
