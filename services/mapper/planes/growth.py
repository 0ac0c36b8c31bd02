"""Lets the map grow: known patches over their edges, new patches where nothing was known."""

from __future__ import annotations

import math
from collections.abc import Iterable
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from services.mapper.planes.alignment import Counts
from services.mapper.planes.association import CONTRADICTED, UNEXPLAINED, Association, associate, room_for
from services.mapper.planes.extraction import MAX_RADIUS_M, extract_planes
from services.mapper.planes.noise import NUM_RANGE_BINS, sigma_by_range
from services.mapper.planes.order import in_order
from services.mapper.planes.patches import PatchArrays, PatchMap
from services.mapper.planes.runs import Runs, cut_runs
from services.mapper.planes.voxel_table import VoxelTable, put_about, put_around, slot_at
from services.mapper.registration import Points, RegistrationError
from shared.kernel import kernel, lean_kernel
from shared.runtime.config import MapperConfig

Float = NDArray[np.float64]

_MIN_HITS = 6
"""So many runs on a patch's plane in a voxel beside it, and the patch reaches there: strays are fewer."""
_MIN_PATCHES = 3
_MIN_VOXEL_M = 0.1
_SIGMAS_A_VOXEL = 4.0
"""A voxel in which noise is as thick as the voxel has no flat piece."""
_VOXEL_SCALES = np.array([1.0, 2.0, 4.0])
_LEAST_SHARE = 0.3
"""Where patches explain less of a scan, its points lie too far apart for the voxels; larger ones are tried."""
_MIN_LEFT_RUNS = 60
_MAX_NEW_PLANES = 500
_SAME_COSINE = 0.99
_SAME_OFFSET_M = 0.02


@kernel()
def _candidate(entries: NDArray[np.int32], patches: PatchArrays, p: Float, ray: Float, gate_m: float) -> int:
    """The patch that passes near p (3,), is nearest to it and faces the ray (3,); -1 if none is within the gate."""
    best, best_m = -1, gate_m
    for k in range(len(entries)):
        if entries[k] < 0:
            break
        j = entries[k] >> 1
        plane = patches.planes[j]
        distance_m = abs(np.sum(plane[:3] * p) + plane[3])
        is_facing = np.sum(plane[:3] * ray) < 0.0
        away = p - patches.origins[j]
        if distance_m < best_m and is_facing and np.sum(away * away) < MAX_RADIUS_M**2:
            best, best_m = j, distance_m
    return best


@kernel()
def _extend(
    runs: Runs, T: Float, found: Association, table: VoxelTable, wide: VoxelTable, patches: PatchArrays
) -> None:
    ray, p = np.empty(3), np.empty(3)
    for i in range(len(runs.centroids_m)):
        if found.assigned[i] != CONTRADICTED:
            continue
        c = runs.centroids_m[i]
        for r in range(3):
            ray[r] = T[r, 0] * c[0] + T[r, 1] * c[1] + T[r, 2] * c[2]
            p[r] = ray[r] + T[r, 3]
        slot = slot_at(table, p[0], p[1], p[2])
        j = _candidate(table.lists[slot], patches, p, ray, 2.5 * runs.sigma_m[i])
        if j < 0:
            continue
        table.hits[slot] += 1
        if table.hits[slot] == _MIN_HITS:
            table.hits[slot] = 0
            put_about(table, p[0], p[1], p[2], j)
            put_around(wide, p[0], p[1], p[2], j)


def extend_patches(patch_map: PatchMap, runs: Runs, T_map_lidar: Float, found: Association) -> None:
    """Known patches reach into voxels beside them in which enough runs lie on their planes."""
    patch_map.make_room()
    _extend(runs, T_map_lidar, found, patch_map.narrow, patch_map.wide, patch_map.arrays)


def add_new_patches(patch_map: PatchMap, runs: Runs, T_map_lidar: Float, assigned: NDArray[np.int32]) -> int:
    """Takes up planes among the runs that nothing explains; returns how many patches are new."""
    left = np.flatnonzero(assigned[: len(runs.num_points)] == UNEXPLAINED)
    before = patch_map.num_patches
    if len(left) < _MIN_LEFT_RUNS:
        return 0
    planes, labels = extract_planes(runs, left, T_map_lidar, patch_map.voxel_m, _MAX_NEW_PLANES)
    if not len(planes):
        return 0
    is_new = labels >= 0
    left, labels = left[is_new], labels[is_new]
    points_m = runs.centroids_m[left] @ T_map_lidar[:, :3].T + T_map_lidar[:, 3]
    indices = np.full(len(planes), -1)
    for k, plane in enumerate(planes):
        centre_m = points_m[labels == k].mean(axis=0)
        same = _same_patch(patch_map.arrays, patch_map.num_patches, plane, centre_m)
        indices[k] = same if same >= 0 else patch_map.append(plane, centre_m)
    patch_map.list_points(points_m, indices[labels])
    return patch_map.num_patches - before


def take_in(patch_map: PatchMap, runs: Runs, T_map_lidar: Float, found: Association) -> None:
    """A scan was at a pose (3, 4): the patches that it was associated with there learn from it, and new ones begin."""
    patch_map.add(T_map_lidar, found)
    extend_patches(patch_map, runs, T_map_lidar, found)
    before = patch_map.num_patches
    if add_new_patches(patch_map, runs, T_map_lidar, found.assigned):
        associate(runs, 1, T_map_lidar, patch_map.narrow, patch_map.arrays.planes, found)
        patch_map.add(T_map_lidar, found, before)


def first_map(points_lidar_m: Points, T_map_lidar: Float, config: MapperConfig) -> tuple[PatchMap, Counts]:
    """A map of one scan (N, 3), which was at a pose (3, 4), and how much of the scan it explains.

    Raises:
        RegistrationError: the scan shows fewer than three patches of plane.
    """
    points_lidar_m, known = in_order(points_lidar_m), config.range_noise_m
    sigma_m = sigma_by_range(points_lidar_m) if known is None else np.full(NUM_RANGE_BINS, known)
    runs = cut_runs(points_lidar_m, sigma_m)
    usual_m = float(np.median(runs.sigma_m)) if len(runs.sigma_m) else 0.0
    for voxel_m in max(_MIN_VOXEL_M, _SIGMAS_A_VOXEL * usual_m) * _VOXEL_SCALES:
        patch_map, found = (
            PatchMap(config.max_planes, sigma_m, voxel_m),
            room_for(config.max_planes, len(runs.num_points)),
        )
        take_in(patch_map, runs, T_map_lidar, found)
        counts = Counts(*associate(runs, 1, T_map_lidar, patch_map.narrow, patch_map.arrays.planes, found), 0)
        if counts.num_explained > _LEAST_SHARE * counts.num_points:
            break
    if patch_map.num_patches < _MIN_PATCHES:
        raise RegistrationError(f"a scan of {len(points_lidar_m)} points shows too few planes to align others to")
    return patch_map, counts


def map_of_scans(scans: Iterable[Points], poses: Iterable[Float], config: MapperConfig) -> PatchMap:
    """A map of scans (N, 3) that were at poses (3, 4), whatever method found them.

    Raises:
        RegistrationError: no scan shows three patches of plane.
    """
    patch_map: PatchMap | None = None
    for points_lidar_m, T in zip(scans, poses, strict=True):
        if patch_map is None:
            with suppress(RegistrationError):
                patch_map, _ = first_map(points_lidar_m, T, config)
            continue
        runs = cut_runs(in_order(points_lidar_m), patch_map.sigma_by_range_m)
        found = room_for(config.max_planes, len(runs.num_points))
        associate(runs, 1, T, patch_map.narrow, patch_map.arrays.planes, found)
        take_in(patch_map, runs, T, found)
    if patch_map is None:
        raise RegistrationError("no scan shows enough planes to make a map of")
    return patch_map


@lean_kernel()
def _same_patch(patches: PatchArrays, num_patches: int, plane: Float, centre_m: Float) -> int:
    """The patch of which a new piece of plane is a part; -1 if there is none."""
    best, best_m = -1, MAX_RADIUS_M
    for j in range(num_patches):
        p, o = patches.planes[j], patches.origins[j]
        x, y, z = o[0] - centre_m[0], o[1] - centre_m[1], o[2] - centre_m[2]
        away_m = math.sqrt(x * x + y * y + z * z)
        cosine = p[0] * plane[0] + p[1] * plane[1] + p[2] * plane[2]
        offset_m = abs(p[0] * centre_m[0] + p[1] * centre_m[1] + p[2] * centre_m[2] + p[3])
        if away_m < best_m and cosine > _SAME_COSINE and offset_m < _SAME_OFFSET_M:
            best, best_m = j, away_m
    return best
