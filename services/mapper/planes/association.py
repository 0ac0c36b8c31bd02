"""Which patch each run of a scan lies on, at a pose; what the runs on a patch say of it, as moments."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.mapper.planes.moments import NUM_MOMENTS, squares_to
from services.mapper.planes.runs import Runs
from services.mapper.planes.voxel_table import VoxelTable, slot_at
from shared.kernel import lean_kernel

Float = NDArray[np.float64]

UNEXPLAINED = -1
"""Nothing known is near: new surface, or free space."""
AMBIGUOUS = -2
"""Two patches are near, or the run lies across an edge: it says nothing."""
CONTRADICTED = -3
"""A patch is near, but the run is not on it."""

REASSOCIATED = {"contract", "arcp", "nsz", "reassoc"}
"""Sums may be reordered and fused; infinities and NaN keep their meaning."""

_NEAR_M = 0.035
"""A run that is on no patch, but nearer than this (and the noise) to one, contradicts it."""
_SAME_COSINE = 0.985
_SAME_OFFSET_M, _SAME_SIGMAS = 0.006, 0.5
"""Patches whose planes differ by less at a run go on in one plane there; noise leaves young patches less alike."""
_SPREADS = 2.0
"""Of a run's points, evenly spread ones reach 1.7 standard deviations from their mean."""
_MIN_COSINE = 0.1
"""Beyond 84 degrees of incidence the footprint smears over the edge of a bar."""
_LEAST_COSINE = 0.3
"""Noise across the surface is that of the range times this cosine, but the rays' directions are not exact either."""
_FAR_M = 1e9


class Association(NamedTuple):
    """Runs by patch. Sized for all patches (C) and runs (R) that may come, and used again for each pass.

    moments (C, 10): in the lidar frame, weighted by 1 / variance. num_points (C,). touched (C,): the patches with any,
    the first num_touched (1,) of them. assigned (R,) int32: the patch of each run, or one of the codes above.
    """

    moments: Float
    num_points: NDArray[np.int64]
    touched: NDArray[np.int64]
    num_touched: NDArray[np.int64]
    assigned: NDArray[np.int32]


def room_for(num_patches: int, num_runs: int) -> Association:
    """An empty association of so many patches and runs."""
    return Association(
        np.zeros((num_patches, NUM_MOMENTS)),
        np.zeros(num_patches, np.int64),
        np.zeros(num_patches, np.int64),
        np.zeros(1, np.int64),
        np.full(num_runs, UNEXPLAINED, np.int32),
    )


@lean_kernel()
def clear(out: Association) -> None:
    """Forgets all runs."""
    for k in range(out.num_touched[0]):
        out.num_points[out.touched[k]] = 0
        for moment in range(NUM_MOMENTS):
            out.moments[out.touched[k], moment] = 0.0
    out.num_touched[0] = 0


@lean_kernel(fastmath=REASSOCIATED)
def _add(out: Association, patch: int, M: Float, num_points: int, weight: float) -> None:
    if out.num_points[patch] == 0:
        out.touched[out.num_touched[0]] = patch
        out.num_touched[0] += 1
    out.num_points[patch] += num_points
    for k in range(NUM_MOMENTS):
        out.moments[patch, k] += weight * M[k]


@lean_kernel(fastmath=REASSOCIATED)
def _offset(plane: Float, p: tuple[float, float, float]) -> float:
    """Of a point from a plane (4,), in metres, to the side of its normal."""
    return float(plane[0] * p[0] + plane[1] * p[1] + plane[2] * p[2] + plane[3])


@lean_kernel(fastmath=REASSOCIATED)
def _seek(
    entries: NDArray[np.int32],
    planes: Float,
    p: tuple[float, float, float],
    ray: tuple[float, float, float],
    along: tuple[float, float, float],
    slope: float,
    gate_m: float,
    is_wide: bool,
) -> tuple[int, float]:
    """The nearest patch within the gate that faces the sensor and may hold the run, or -1; its distance."""
    best, best_m = -1, gate_m
    for k in range(len(entries)):
        if entries[k] < 0:
            break
        j = entries[k] >> 1
        a, b, c = planes[j, 0], planes[j, 1], planes[j, 2]
        distance_m = abs(_offset(planes[j], p))
        is_facing = a * ray[0] + b * ray[1] + c * ray[2] < 0.0
        is_along = abs(a * along[0] + b * along[1] + c * along[2]) < slope
        if distance_m < best_m and is_facing and is_along and (is_wide or entries[k] & 1):
            best, best_m = j, distance_m
    return best, best_m


@lean_kernel(fastmath=REASSOCIATED)
def _next(
    entries: NDArray[np.int32], planes: Float, p: tuple[float, float, float], best: int, same_m: float
) -> tuple[int, float]:
    """The nearest patch but the best and what goes on in its plane within `same_m`, or -1; its distance."""
    nearest, nearest_m = -1, _FAR_M
    for k in range(len(entries)):
        if entries[k] < 0:
            break
        j = entries[k] >> 1
        offset_m = _offset(planes[j], p)
        if j == best or abs(offset_m) >= nearest_m:
            continue
        if best >= 0:
            n, m = planes[best], planes[j]
            is_parallel = n[0] * m[0] + n[1] * m[1] + n[2] * m[2] > _SAME_COSINE
            if is_parallel and abs(offset_m - _offset(planes[best], p)) < same_m:
                continue
        nearest, nearest_m = j, abs(offset_m)
    return nearest, nearest_m


@lean_kernel(fastmath=REASSOCIATED)
def _turn(T: Float, p: Float) -> tuple[float, float, float]:
    """R p of the pose T (3, 4)."""
    return (
        T[0, 0] * p[0] + T[0, 1] * p[1] + T[0, 2] * p[2],
        T[1, 0] * p[0] + T[1, 1] * p[1] + T[1, 2] * p[2],
        T[2, 0] * p[0] + T[2, 1] * p[1] + T[2, 2] * p[2],
    )


@lean_kernel(fastmath=REASSOCIATED)
def _cosine(plane: Float, ray: tuple[float, float, float]) -> float:
    """Of the incidence: 1 where the ray meets the plane at right angles."""
    along = -(plane[0] * ray[0] + plane[1] * ray[1] + plane[2] * ray[2])
    return float(along) / math.sqrt(ray[0] * ray[0] + ray[1] * ray[1] + ray[2] * ray[2])


@lean_kernel(fastmath=REASSOCIATED)
def _squares(M: Float, T: Float, plane: Float) -> float:
    """The sum of squared distances of a run's points, whose moments are M (10,), from a plane of the map."""
    a0 = T[0, 0] * plane[0] + T[1, 0] * plane[1] + T[2, 0] * plane[2]
    a1 = T[0, 1] * plane[0] + T[1, 1] * plane[1] + T[2, 1] * plane[2]
    a2 = T[0, 2] * plane[0] + T[1, 2] * plane[1] + T[2, 2] * plane[2]
    a3 = T[0, 3] * plane[0] + T[1, 3] * plane[1] + T[2, 3] * plane[2] + plane[3]
    return float(squares_to(M, a0, a1, a2, a3))


@lean_kernel(fastmath=REASSOCIATED)
def _is_scattered(M: Float, T: Float, plane: Float, sigma_m: float, cosine: float) -> bool:
    """Whether the points of a run lie farther off the plane than three standard deviations of what noise does."""
    k = M[9]
    if k < 3.0:
        return False
    usual = k * sigma_m * sigma_m * (cosine * cosine + 0.05)
    return bool(_squares(M, T, plane) > usual * (1.0 + 3.0 * math.sqrt(2.0 / k)))


@lean_kernel(fastmath=REASSOCIATED)
def _reaches(M: Float, T: Float, plane: Float, distance_m: float, across_m: float) -> bool:
    """Whether some points of a run, which is so far from a plane, may lie on it.

    across_m: noise across the plane.
    """
    spread_m2 = max(_squares(M, T, plane) / M[9] - distance_m * distance_m, 0.0)
    return bool(distance_m < _SPREADS * math.sqrt(spread_m2 + across_m * across_m))


@lean_kernel(fastmath=REASSOCIATED)
def seek_wide(runs: Runs, i: int, T: Float, table: VoxelTable, planes: Float, gate_m: float) -> tuple[int, float]:
    """The patch on which run i may lie at a pose T (3, 4), as far as a wide gate says, and its distance; or -1."""
    ray = _turn(T, runs.centroids_m[i])
    p = (ray[0] + T[0, 3], ray[1] + T[1, 3], ray[2] + T[2, 3])
    entries = table.lists[slot_at(table, p[0], p[1], p[2])]
    slope = 0.25 + 3.0 * runs.slopes[i]
    j, distance_m = _seek(entries, planes, p, ray, _turn(T, runs.directions[i]), slope, gate_m, True)
    if j >= 0 and _cosine(planes[j], ray) < _MIN_COSINE:
        j = -1
    return j, distance_m


@lean_kernel(fastmath=REASSOCIATED)
def associate_wide(
    runs: Runs, stride: int, T: Float, table: VoxelTable, planes: Float, gate_m: float, out: Association
) -> None:
    """Takes every stride-th run to the nearest patch within a wide gate, the nearer the more it counts (Tukey)."""
    clear(out)
    for i in range(0, len(runs.centroids_m), stride):
        sigma_m = runs.sigma_m[i]
        reach_m = max(gate_m, 4.0 * sigma_m)
        j, distance_m = seek_wide(runs, i, T, table, planes, reach_m)
        if j < 0:
            continue
        cosine = _cosine(planes[j], _turn(T, runs.centroids_m[i]))
        tukey = 1.0 - (distance_m / reach_m) ** 2
        weight = (tukey / (sigma_m * max(cosine, _LEAST_COSINE))) ** 2
        _add(out, j, runs.moments[i], runs.num_points[i], weight)


@lean_kernel(fastmath=REASSOCIATED)
def associate(
    runs: Runs, stride: int, T: Float, table: VoxelTable, planes: Float, out: Association
) -> tuple[int, int, int]:
    """Takes every stride-th run to the patch it is on, within what noise allows.

    T (3, 4): T_map_lidar. Returns the numbers of points that are explained, contradicted, and all.
    """
    clear(out)
    explained, contradicted, num = 0, 0, 0
    for i in range(0, len(runs.centroids_m), stride):
        ray, sigma_m, k = _turn(T, runs.centroids_m[i]), runs.sigma_m[i], runs.num_points[i]
        num += k
        p = (ray[0] + T[0, 3], ray[1] + T[1, 3], ray[2] + T[2, 3])
        entries = table.lists[slot_at(table, p[0], p[1], p[2])]
        slope, gate_m = 0.25 + 3.0 * runs.slopes[i], sigma_m * (0.7 + 2.4 / math.sqrt(k))
        j, _ = _seek(entries, planes, p, ray, _turn(T, runs.directions[i]), slope, gate_m, False)
        other, other_m = _next(entries, planes, p, j, _SAME_OFFSET_M + _SAME_SIGMAS * sigma_m)
        if j < 0:
            is_near = other_m < _NEAR_M + sigma_m
            out.assigned[i] = CONTRADICTED if is_near else UNEXPLAINED
            contradicted += k if is_near else 0
            continue
        out.assigned[i] = AMBIGUOUS
        cosine = _cosine(planes[j], ray)
        if cosine < _MIN_COSINE or _is_scattered(runs.moments[i], T, planes[j], sigma_m, cosine):
            continue
        if other >= 0 and _reaches(
            runs.moments[i], T, planes[other], other_m, sigma_m * abs(_cosine(planes[other], ray))
        ):
            continue
        out.assigned[i] = j
        explained += k
        across_m = sigma_m * max(cosine, _LEAST_COSINE)
        _add(out, j, runs.moments[i], k, 1.0 / (across_m * across_m))
    return explained, contradicted, num
