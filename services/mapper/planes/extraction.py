"""Finds pieces of plane in runs of which the map knows nothing: flat voxels, grown over their neighbours."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.mapper.planes.moments import NUM_MOMENTS, add_moved, fit_plane, squares_to
from services.mapper.planes.runs import Runs
from services.mapper.planes.voxel_table import voxel_key
from shared.kernel import kernel, lean_kernel

Float = NDArray[np.float64]
Int = NDArray[np.int64]

MAX_RADIUS_M = 0.7
"""Of a patch about its first voxel: beyond, steel is not flat to the millimetre, and neither is an early pose."""
MIN_POINTS = 30
"""A patch of fewer would be tilted by its noise."""
_MIN_SEED_POINTS = 6
_FLATNESS = 1.3
"""Noise across a plane is at most that of the range; an edge in the voxel spreads the points farther."""
_MIN_WIDTH_M = 0.02
"""Standard deviation along the shorter side: less is a line of points, which lies on many planes."""
_REFIT_GROWTH = 1.2
_STEPS = (-1, 0, 1)


class Cloud(NamedTuple):
    """Runs by voxel, about the lidar along the map's axes.

    centroids_m (S, 3), moments (S, 10), sigma_m (S,): of the runs, sorted by voxel. keys (V,): of the voxels,
    increasing. starts (V + 1,): where the runs of a voxel begin. inverse_m: 1 / edge of a voxel.
    """

    centroids_m: Float
    moments: Float
    sigma_m: Float
    keys: Int
    starts: Int
    inverse_m: float


@kernel()
def _level(runs: Runs, chosen: Int, T: Float, inverse_m: float) -> tuple[Float, Float, Int]:
    """Centroids and moments of the chosen runs, turned to the map's axes, and the keys of their voxels."""
    R = np.ascontiguousarray(T[:, :3])
    centroids_m, moments, keys = (
        np.empty((len(chosen), 3)),
        np.zeros((len(chosen), NUM_MOMENTS)),
        np.empty(len(chosen), np.int64),
    )
    for i in range(len(chosen)):
        add_moved(runs.moments[chosen[i]], R, 0.0, 0.0, 0.0, moments[i])
        M = moments[i]
        centroids_m[i, 0], centroids_m[i, 1], centroids_m[i, 2] = M[3] / M[9], M[6] / M[9], M[8] / M[9]
        keys[i] = voxel_key(centroids_m[i, 0], centroids_m[i, 1], centroids_m[i, 2], inverse_m)
    return centroids_m, moments, keys


@lean_kernel()
def _is_on(M: Float, plane: Float, sigma_m: float) -> bool:
    """Whether the points of a run lie on a plane, as far as noise allows."""
    k = M[9]
    usual = k * sigma_m * sigma_m * (1.0 + 4.0 * math.sqrt(2.0 / k))
    return bool(squares_to(M, plane[0], plane[1], plane[2], plane[3]) < usual)


@kernel()
def _seed(cloud: Cloud, v: int, labels: Int, plane: Float) -> bool:
    """Writes the plane of what is left in a voxel; whether that is flat and wide."""
    M, sigma_m, num = np.zeros(NUM_MOMENTS), 0.0, 0
    for i in range(cloud.starts[v], cloud.starts[v + 1]):
        if labels[i] < 0:
            M += cloud.moments[i]
            sigma_m += cloud.sigma_m[i]
            num += 1
    if M[9] < _MIN_SEED_POINTS or num < 2:
        return False
    across, along = fit_plane(M, plane)
    return across < (_FLATNESS * sigma_m / num) ** 2 and along > _MIN_WIDTH_M**2


@lean_kernel()
def _is_within(cloud: Cloud, i: int, centre: Float) -> bool:
    c = cloud.centroids_m[i]
    x, y, z = c[0] - centre[0], c[1] - centre[1], c[2] - centre[2]
    return bool(x * x + y * y + z * z < MAX_RADIUS_M * MAX_RADIUS_M)


@kernel()
def _push_neighbours(cloud: Cloud, v: int, region: int, visited: Int, queue: Int, num: int) -> int:
    for a in _STEPS:
        for b in _STEPS:
            for c in _STEPS:
                key = cloud.keys[v] + ((a << 42) + (b << 21) + c)
                w = np.searchsorted(cloud.keys, key)
                if w < len(cloud.keys) and cloud.keys[w] == key and visited[w] != region:
                    visited[w] = region
                    queue[num] = w
                    num += 1
    return num


@kernel()
def _collect(cloud: Cloud, v: int, region: int, plane: Float, centre: Float, labels: Int, M: Float) -> int:
    """Labels what of a voxel lies on the plane, and adds it to the moments M; returns how many runs it was."""
    num = 0
    for i in range(cloud.starts[v], cloud.starts[v + 1]):
        if labels[i] < 0 and _is_on(cloud.moments[i], plane, cloud.sigma_m[i]) and _is_within(cloud, i, centre):
            labels[i] = region
            M += cloud.moments[i]
            num += 1
    return num


@kernel()
def _grow(cloud: Cloud, seed: int, region: int, plane: Float, labels: Int, visited: Int, queue: Int) -> int:
    """Labels the region about a seed, refitting the plane as it grows; returns how many voxels were looked at."""
    first, last = cloud.starts[seed], cloud.starts[seed + 1]
    centre = np.zeros(3)
    for i in range(first, last):
        centre += cloud.centroids_m[i] / (last - first)
    M, fitted = np.zeros(NUM_MOMENTS), float(MIN_POINTS)
    visited[seed], queue[0], num, head = region, seed, 1, 0
    while head < num:
        v = queue[head]
        head += 1
        if _collect(cloud, v, region, plane, centre, labels, M) == 0:
            continue
        if M[9] > _REFIT_GROWTH * fitted:
            fit_plane(M, plane)
            fitted = M[9]
        num = _push_neighbours(cloud, v, region, visited, queue, num)
    return num


@kernel()
def _settle(cloud: Cloud, region: int, plane: Float, labels: Int, queue: Int, num: int) -> bool:
    """Fits the plane to the region and lets go what is not on it; whether it is a patch. If not, all is let go."""
    M, sigma_m, num_runs = np.zeros(NUM_MOMENTS), 0.0, 0
    for q in range(num):
        for i in range(cloud.starts[queue[q]], cloud.starts[queue[q] + 1]):
            if labels[i] == region:
                M += cloud.moments[i]
                sigma_m += cloud.sigma_m[i]
                num_runs += 1
    is_patch = bool(M[9] >= MIN_POINTS)
    if is_patch:
        across, along = fit_plane(M, plane)
        is_patch = bool(across < (_FLATNESS * sigma_m / num_runs) ** 2 and along > _MIN_WIDTH_M**2)
    for q in range(num):
        for i in range(cloud.starts[queue[q]], cloud.starts[queue[q] + 1]):
            if labels[i] == region and not (is_patch and _is_on(cloud.moments[i], plane, cloud.sigma_m[i])):
                labels[i] = -1
    return is_patch


@kernel()
def _regions(cloud: Cloud, seeds: Int, labels: Int, planes: Float) -> int:
    """Labels the runs (S,) with the region they belong to, or -1; writes the regions' planes, facing the lidar."""
    visited, queue = np.full(len(cloud.keys), -1, np.int64), np.empty(len(cloud.keys), np.int64)
    plane, num, attempt = np.empty(4), 0, 0
    for v in seeds:
        if num == len(planes):
            break
        if not _seed(cloud, v, labels, plane):
            continue
        # A region that came to nothing leaves its number in `visited`: numbers below 0 tell attempts apart.
        attempt += 1
        num_voxels = _grow(cloud, v, len(planes) + attempt, plane, labels, visited, queue)
        if _settle(cloud, len(planes) + attempt, plane, labels, queue, num_voxels):
            for q in range(num_voxels):
                for i in range(cloud.starts[queue[q]], cloud.starts[queue[q] + 1]):
                    if labels[i] == len(planes) + attempt:
                        labels[i] = num
            planes[num] = plane if plane[3] > 0.0 else -plane
            num += 1
    return num


@kernel()
def _by_voxel(runs: Runs, chosen: Int, T: Float, inverse_m: float) -> tuple[Cloud, Int]:
    """The chosen runs by voxel, and the order that brings them there."""
    centroids_m, moments, keys = _level(runs, chosen, T, inverse_m)
    order = np.argsort(keys, kind="mergesort")
    voxels, starts, num = np.empty(len(keys), np.int64), np.empty(len(keys) + 1, np.int64), 0
    for i in range(len(order)):
        if i == 0 or keys[order[i]] != voxels[num - 1]:
            voxels[num], starts[num] = keys[order[i]], i
            num += 1
    starts[num] = len(order)
    sigma_m = runs.sigma_m[chosen][order]
    return Cloud(centroids_m[order], moments[order], sigma_m, voxels[:num], starts[: num + 1], inverse_m), order


@kernel()
def _seeds(cloud: Cloud) -> Int:
    """The voxels with enough points to begin with, those with the most first."""
    num_points = np.zeros(len(cloud.keys))
    for v in range(len(cloud.keys)):
        for i in range(cloud.starts[v], cloud.starts[v + 1]):
            num_points[v] += cloud.moments[i, 9]
    order = np.argsort(-num_points, kind="mergesort")
    return order[num_points[order] >= _MIN_SEED_POINTS]


def extract_planes(runs: Runs, chosen: Int, T_map_lidar: Float, voxel_m: float, max_planes: int) -> tuple[Float, Int]:
    """Pieces of plane among the chosen runs (S,) of a scan at a pose (3, 4).

    Returns their planes (P, 4) in the map frame, facing the lidar, and the piece that each chosen run lies on (S,),
    or -1.
    """
    planes = np.zeros((max_planes, 4))
    labels = np.full(len(chosen), -1, dtype=np.int64)
    if not len(chosen):
        return planes[:0], labels
    cloud, order = _by_voxel(runs, chosen, T_map_lidar, 1.0 / voxel_m)
    sorted_labels = labels.copy()
    num = _regions(cloud, _seeds(cloud), sorted_labels, planes)
    labels[order] = sorted_labels
    planes = planes[:num]
    planes[:, 3] -= planes[:, :3] @ T_map_lidar[:, 3]
    return planes, labels
