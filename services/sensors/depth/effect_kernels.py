"""The errors of a stereo camera, row by row: what it matches, what it cannot match, and how well."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.sensors.depth.correlated import Float32, Spline, add_row, knot_rows
from services.sensors.depth.edge_jitter import BLOCK_PX, displace_row, edge_blocks, jitter_row
from services.sensors.depth.shadow import shade_row
from services.sensors.noise_hash import hash64, normal_of, uniform
from shared.kernel import kernel

PIXEL_STREAM, DISPARITY_STREAM, RIGHT_STREAM, DOWN_STREAM, HOLE_STREAM = range(5)

_CHUNK_PX = 64
_MAX_MM = np.float32(65_535.0)


class Stereo(NamedTuple):
    """The errors' sizes as the kernels take them; see `DepthConfig` for what is not said here. 0 = without.

    focal_baseline_px_m: focal length times baseline. fade_rad: angle up to max_incidence_rad in which holes become
    certain.
    """

    focal_baseline_px_m: np.float32
    correlated_noise_px: np.float32
    white_noise_px: np.float32
    disparity_quantum_px: np.float32
    max_disparity_px: np.float32
    min_range_m: np.float32
    max_range_m: np.float32
    edge_jitter_px: np.float32
    has_shadow: bool
    max_incidence_rad: float
    fade_rad: float


@kernel()
def match(
    depth_m: Float32,
    cos_incidence: Float32,
    static_px: Float32,
    spline: Spline,
    stereo: Stereo,
    seed: np.uint64,
) -> NDArray[np.uint16]:
    """Depths in mm (H, W), 0 where there is none, of true depths (H, W).

    static_px (H, W): noise of the disparity that stays; of shape (0, 0) if there is none. seed: of this image.
    """
    height, width = depth_m.shape
    depth_mm = np.empty((height, width), dtype=np.uint16)
    shared_px = knot_rows(spline, seed, DISPARITY_STREAM)
    moved_px = (knot_rows(spline, seed, RIGHT_STREAM), knot_rows(spline, seed, DOWN_STREAM))
    is_edge = edge_blocks(depth_m, stereo.edge_jitter_px)
    rows = np.empty((4, width), dtype=np.float32)
    disparity_px, row_cos, error_px, scratch = rows[0], rows[1], rows[2], rows[3]
    displacements_px = np.empty((2, width), dtype=np.float32)
    outlines = np.empty(width, dtype=np.int32)
    for v in range(height):
        disparity_px[:], row_cos[:] = depth_m[v], cos_incidence[v]
        blocks = is_edge[v // BLOCK_PX]
        if blocks.any():
            displace_row(moved_px, spline, v, stereo.edge_jitter_px, displacements_px)
            jitter_row(depth_m, cos_incidence, v, blocks, displacements_px, disparity_px, row_cos)
        _to_disparity(disparity_px, stereo.focal_baseline_px_m)
        if stereo.has_shadow:
            shade_row(disparity_px, scratch, outlines)
        if stereo.max_incidence_rad < math.pi / 2:
            _drop_grazing(disparity_px, row_cos, stereo, seed, v * width)
        error_px[:] = np.float32(0.0)
        add_row(shared_px, spline, v, stereo.correlated_noise_px, error_px)
        if len(static_px) > 0:
            error_px += static_px[v]
        if stereo.white_noise_px > 0.0:
            _add_white(error_px, stereo.white_noise_px, seed, v * width)
        _measure(disparity_px, error_px, stereo, depth_mm[v])
    return depth_mm


@kernel(fastmath={"arcp", "contract"})
def _to_disparity(row_m: Float32, focal_baseline_px_m: np.float32) -> None:
    for u in range(len(row_m)):
        row_m[u] = focal_baseline_px_m / row_m[u]


@kernel()
def _drop_grazing(disparity_px: Float32, cos_incidence: Float32, stereo: Stereo, seed: np.uint64, first: int) -> None:
    """Sets the disparity to 0 with a chance that rises linearly with the angle of incidence."""
    start_rad = stereo.max_incidence_rad - stereo.fade_rad
    cos_start = np.float32(math.cos(max(start_rad, 0.0)))
    width = len(disparity_px)
    for start in range(0, width, _CHUNK_PX):
        end = min(start + _CHUNK_PX, width)
        if not _has_grazing(disparity_px[start:end], cos_incidence[start:end], cos_start):
            continue
        for u in range(start, end):
            if cos_incidence[u] <= cos_start and disparity_px[u] > 0.0:
                beyond_rad = math.acos(cos_incidence[u]) - start_rad
                if beyond_rad > uniform(seed, HOLE_STREAM, first + u) * stereo.fade_rad:
                    disparity_px[u] = np.float32(0.0)


@kernel()
def _has_grazing(disparity_px: Float32, cos_incidence: Float32, cos_start: np.float32) -> bool:
    num = 0
    for u in range(len(disparity_px)):
        num += (cos_incidence[u] <= cos_start) & (disparity_px[u] > 0.0)
    return num > 0


@kernel()
def _add_white(error_px: Float32, sigma_px: np.float32, seed: np.uint64, first: int) -> None:
    for u in range(len(error_px)):
        error_px[u] += sigma_px * normal_of(hash64(seed, PIXEL_STREAM, first + u))


@kernel(fastmath={"arcp", "contract"})
def _measure(disparity_px: Float32, error_px: Float32, stereo: Stereo, depth_mm: NDArray[np.uint16]) -> None:
    """The depths of disparities with an error, in steps of the quantum."""
    quantum, most = stereo.disparity_quantum_px, stereo.max_disparity_px
    steps = np.float32(1.0) / quantum if quantum > 0.0 else np.float32(0.0)
    most = most if most > 0.0 else np.float32(np.inf)
    least_mm, most_mm = np.float32(1000.0) * stereo.min_range_m, np.float32(1000.0) * stereo.max_range_m
    scale = np.float32(1000.0) * stereo.focal_baseline_px_m
    for u in range(len(disparity_px)):
        disparity = disparity_px[u] + error_px[u]
        if quantum > 0.0:
            disparity = np.rint(disparity * steps) * quantum
        mm = np.rint(scale / disparity)
        is_matched = disparity_px[u] > 0.0 and disparity > 0.0 and disparity <= most
        is_given = is_matched and mm >= least_mm and mm <= min(most_mm, _MAX_MM)
        depth_mm[u] = np.uint16(mm) if is_given else np.uint16(0)
