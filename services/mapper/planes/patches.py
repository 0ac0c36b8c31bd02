"""The map: pieces of plane, each with the moments of all points ever seen on it, and the voxels they were seen in."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.mapper.planes.association import Association
from services.mapper.planes.moments import NUM_MOMENTS, add_moved, fit_plane
from services.mapper.planes.voxel_table import VoxelTable, empty_table, put_about, put_around, with_room
from shared.kernel import kernel, lean_kernel

Float = NDArray[np.float64]

WIDE_VOXEL_M = 0.2
_PATCHES_A_VOXEL = 6
_PATCHES_A_WIDE_VOXEL = 12
MAX_SLOTS = 1 << 20
"""Of a voxel table: 32 MB, or 750,000 voxels; a surface of 10 m x 10 m takes 10,000 with those near to it."""
_POINTS_AT_ONCE = 256
_MIN_POINTS = 5
"""Fewer points of a scan on a patch are left out: they are mostly strays at its edge."""


class PatchArrays(NamedTuple):
    """Patches, in the map frame, by index; rows that no patch has yet are 0.

    planes (C, 4): n.x + d = 0, with n of length 1, pointing to the side from which it was seen. origins (C, 3): the
    centre when it was found. moments (C, 10): of its points about its origin along the map's axes, weighted by
    1 / variance. num_points (C,).
    """

    planes: Float
    origins: Float
    moments: Float
    num_points: NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Patches:
    """What is known of patches at one time, in the map frame; all arrays are copies.

    ids (P,) int64: kept for life. planes (P, 4): n.x + d = 0, n points to the side from which it was seen.
    num_points (P,). centres_m (P, 3): of the points. moments (P, 10): about the origins_m (P, 3), weighted.
    """

    ids: NDArray[np.int64]
    planes: Float
    num_points: NDArray[np.int64]
    centres_m: Float
    moments: Float
    origins_m: Float


@kernel()
def _add_moments(T: Float, found: Association, patches: PatchArrays, first: int) -> None:
    R = np.ascontiguousarray(T[:, :3])
    for k in range(found.num_touched[0]):
        j = found.touched[k]
        if j < first or found.num_points[j] < _MIN_POINTS:
            continue
        o = patches.origins[j]
        add_moved(found.moments[j], R, T[0, 3] - o[0], T[1, 3] - o[1], T[2, 3] - o[2], patches.moments[j])
        patches.num_points[j] += found.num_points[j]
        refit(patches, j)


@kernel()
def refit(patches: PatchArrays, j: int) -> None:
    """The plane of a patch from its moments; its side stays."""
    plane, old, o = np.empty(4), patches.planes[j], patches.origins[j]
    fit_plane(patches.moments[j], plane)
    if plane[0] * old[0] + plane[1] * old[1] + plane[2] * old[2] < 0.0:
        plane *= -1.0
    plane[3] -= plane[0] * o[0] + plane[1] * o[1] + plane[2] * o[2]
    old[:] = plane


@lean_kernel()
def _list_points(points_m: Float, patch_of: NDArray[np.int64], narrow: VoxelTable, wide: VoxelTable) -> None:
    for i in range(len(points_m)):
        if patch_of[i] >= 0:
            put_about(narrow, points_m[i, 0], points_m[i, 1], points_m[i, 2], patch_of[i])
            put_around(wide, points_m[i, 0], points_m[i, 1], points_m[i, 2], patch_of[i])


class PatchMap:
    """Patches and where they are. max_patches: further ones are not taken up.

    sigma_by_range_m: noise of a range, of `sigma_by_range`. voxel_m: in which patches are looked for, and found again.
    """

    def __init__(self, max_patches: int, sigma_by_range_m: Float, voxel_m: float) -> None:
        self.voxel_m = voxel_m
        self.sigma_by_range_m = sigma_by_range_m
        self.num_patches = 0
        self._max_patches = max_patches
        room = min(max_patches, 512)
        self.arrays = PatchArrays(
            np.zeros((room, 4)), np.zeros((room, 3)), np.zeros((room, NUM_MOMENTS)), np.zeros(room, np.int64)
        )
        self.narrow = empty_table(self.voxel_m, _PATCHES_A_VOXEL)
        self.wide = empty_table(max(WIDE_VOXEL_M, 2.0 * self.voxel_m), _PATCHES_A_WIDE_VOXEL)

    @property
    def snapshot(self) -> Patches:
        """The patches as they are now."""
        n = self.num_patches
        planes, origins, moments = (values[:n].copy() for values in self.arrays[:3])
        weights = np.maximum(moments[:, 9:], 1e-300)
        centres_m = origins + moments[:, [3, 6, 8]] / weights
        return Patches(np.arange(n), planes, self.arrays.num_points[:n].copy(), centres_m, moments, origins)

    def append(self, plane: Float, origin_m: Float) -> int:
        """A new patch without points, from its plane (4,) and centre (3,); its index, or -1 if there is no room."""
        j = self.num_patches
        if j == self._max_patches:
            return -1
        if j == len(self.arrays.planes):
            grown = (np.concatenate([values, np.zeros_like(values)])[: self._max_patches] for values in self.arrays)
            self.arrays = PatchArrays(*grown)
        self.arrays.planes[j], self.arrays.origins[j] = plane, origin_m
        self.num_patches += 1
        return j

    def list_points(self, points_m: Float, patch_of: NDArray[np.int64]) -> None:
        """The patches (N,) were seen at points (N, 3) in the map frame; -1: none was."""
        for i in range(0, len(points_m), _POINTS_AT_ONCE):
            self.make_room()
            some = slice(i, i + _POINTS_AT_ONCE)
            _list_points(points_m[some], patch_of[some], self.narrow, self.wide)

    def make_room(self) -> None:
        """Enlarges the tables so far that a few hundred points can be listed."""
        self.narrow = with_room(self.narrow, 27 * _POINTS_AT_ONCE, MAX_SLOTS)
        self.wide = with_room(self.wide, 27 * _POINTS_AT_ONCE, MAX_SLOTS)

    def add(self, T_map_lidar: Float, found: Association, first: int = 0) -> None:
        """Takes the moments of an associated scan, whose pose was (3, 4), into the patches from `first` on."""
        _add_moments(T_map_lidar, found, self.arrays, first)
