"""Patches and their voxels as plain arrays, and back."""

from __future__ import annotations

import numpy as np

from services.mapper.planes.patches import MAX_SLOTS, PatchArrays, PatchMap
from services.mapper.planes.voxel_table import VoxelTable, refilled
from services.mapper.state import PlanesState, TableState


def table_state(table: VoxelTable) -> TableState:
    """The slots in use."""
    used = np.flatnonzero(table.keys >= 0)
    lists, hits = table.lists[used].ravel(), table.hits[used]
    return TableState(keys=table.keys[used], lists=lists, hits=hits, num_slots=len(table.keys))


def patch_map_of(state: PlanesState, max_patches: int) -> PatchMap:
    """The map of patches that a state tells of.

    Raises:
        ValueError: it cannot be one of these settings.
    """
    num = len(state.planes)
    if num > max_patches:
        raise ValueError(f"has {num} patches, at most {max_patches} are allowed")
    patch_map = PatchMap(max_patches, state.sigma_by_range_m.copy(), state.voxel_m)
    room = len(patch_map.arrays.planes)
    while room < num:
        room = min(2 * room, max_patches)
    grown = [np.zeros((room, *values.shape[1:]), values.dtype) for values in patch_map.arrays]
    for values, known in zip(grown, (state.planes, state.origins_m, state.moments, state.num_points), strict=True):
        values[:num] = known
    patch_map.arrays = PatchArrays(*grown)
    patch_map.num_patches = num
    patch_map.narrow = _table(patch_map.narrow, state.narrow, num)
    patch_map.wide = _table(patch_map.wide, state.wide, num)
    return patch_map


def _table(empty: VoxelTable, state: TableState, num_patches: int) -> VoxelTable:
    num_slots = state.num_slots
    is_size = num_slots & (num_slots - 1) == 0 and 2 <= num_slots <= MAX_SLOTS and len(state.keys) < num_slots
    is_lists = state.lists.shape == (len(state.keys) * empty.lists.shape[1],)
    is_known = len(state.lists) == 0 or (int(state.lists.min()) >= -1 and int(state.lists.max()) < 2 * num_patches)
    if not (is_size and is_lists and is_known and (state.keys >= 0).all()):
        raise ValueError("a table of voxels does not fit its patches")
    lists = state.lists.reshape(-1, empty.lists.shape[1])
    return refilled(empty, num_slots, state.keys, lists, state.hits)
