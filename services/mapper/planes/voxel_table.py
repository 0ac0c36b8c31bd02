"""Which patches pass through a voxel: lists in an open-addressing hash table, so that space has no bounds."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shared.kernel import kernel, lean_kernel

_BITS = 21
_OFFSET = 1 << (_BITS - 1)
_SHIFT = 0.5
"""Of a voxel: steel is often built, and the sensor often begins, at multiples of a voxel; a face on the border of
two rows of voxels would be told by noise alone to be in one or the other."""
_EMPTY = -1
_FIRST_NUM_SLOTS = 1 << 12


class VoxelTable(NamedTuple):
    """Lists of patches by voxel.

    keys (S,): the voxel of a slot, or -1; S is a power of 2. lists (S, K) int32: 2 * patch + 1 where the patch was
    seen in the voxel, 2 * patch where it only passes near; -1 after the last. hits (S,): of `count_hit`.
    num_used (1,): slots in use. inverse_m (1,): 1 / edge of a voxel.
    """

    keys: NDArray[np.int64]
    lists: NDArray[np.int32]
    hits: NDArray[np.int32]
    num_used: NDArray[np.int64]
    inverse_m: NDArray[np.float64]


def empty_table(voxel_m: float, num_patches_a_voxel: int, num_slots: int = _FIRST_NUM_SLOTS) -> VoxelTable:
    """A table without voxels. num_slots: a power of 2."""
    return VoxelTable(
        np.full(num_slots, _EMPTY, np.int64),
        np.full((num_slots, num_patches_a_voxel), _EMPTY, np.int32),
        np.zeros(num_slots, np.int32),
        np.zeros(1, np.int64),
        np.array([1.0 / voxel_m]),
    )


def with_room(table: VoxelTable, num_more: int, max_slots: int) -> VoxelTable:
    """The table, or one of twice, four ... times the slots that takes so many more voxels; at most `max_slots`.

    Where that is not enough, further voxels are not taken up.
    """
    num_slots = len(table.keys)
    while num_slots < max_slots and 2 * (int(table.num_used[0]) + num_more) > num_slots:
        num_slots *= 2
    if num_slots == len(table.keys):
        return table
    larger = empty_table(1.0 / float(table.inverse_m[0]), table.lists.shape[1], num_slots)
    _copy(table, larger)
    return larger


def refilled(
    table: VoxelTable, num_slots: int, keys: NDArray[np.int64], lists: NDArray[np.int32], hits: NDArray[np.int32]
) -> VoxelTable:
    """A table like an empty one with so many slots, a power of 2, and in it the voxels (K,) and their lists."""
    filled = empty_table(1.0 / float(table.inverse_m[0]), table.lists.shape[1], num_slots)
    _copy(VoxelTable(keys.copy(), lists.copy(), hits.copy(), table.num_used, table.inverse_m), filled)
    return filled


@lean_kernel()
def voxel_key(x: float, y: float, z: float, inverse_m: float) -> int:
    """One integer a voxel, from coordinates in metres; voxels 2^20 and more from the origin share keys."""
    mask = 2 * _OFFSET - 1
    i = (math.floor(x * inverse_m + _SHIFT) + _OFFSET) & mask
    j = (math.floor(y * inverse_m + _SHIFT) + _OFFSET) & mask
    k = (math.floor(z * inverse_m + _SHIFT) + _OFFSET) & mask
    return (i << (2 * _BITS)) | (j << _BITS) | k


@lean_kernel()
def find_slot(keys: NDArray[np.int64], key: int) -> int:
    """The slot of a voxel, or the empty one where it would go (Knuth's multiplicative hash, linear probing)."""
    mask = len(keys) - 1
    slot = ((key * 0x1E3779B97F4A7C15) >> 24) & mask
    while keys[slot] != key and keys[slot] != _EMPTY:
        slot = (slot + 1) & mask
    return slot


@lean_kernel()
def slot_at(table: VoxelTable, x: float, y: float, z: float) -> int:
    """The slot of the voxel at (x, y, z); the list there is empty if the voxel is not known."""
    return find_slot(table.keys, voxel_key(x, y, z, table.inverse_m[0]))


@lean_kernel()
def put(table: VoxelTable, x: float, y: float, z: float, patch: int, is_core: bool) -> None:
    """Lists a patch in the voxel at (x, y, z), if there is room in table and list."""
    key = voxel_key(x, y, z, table.inverse_m[0])
    slot = find_slot(table.keys, key)
    if table.keys[slot] == _EMPTY:
        if 4 * table.num_used[0] >= 3 * len(table.keys):
            return
        table.keys[slot] = key
        table.num_used[0] += 1
    entries = table.lists[slot]
    for k in range(len(entries)):
        if entries[k] == _EMPTY:
            entries[k] = 2 * patch + is_core
            return
        if entries[k] >> 1 == patch:
            entries[k] |= is_core
            return


@lean_kernel()
def is_listed(table: VoxelTable, x: float, y: float, z: float, patch: int) -> bool:
    """Whether the patch was seen in the voxel at (x, y, z)."""
    is_there = False
    for entry in table.lists[slot_at(table, x, y, z)]:
        is_there |= entry == 2 * patch + 1
    return is_there


@lean_kernel()
def put_about(table: VoxelTable, x: float, y: float, z: float, patch: int) -> None:
    """Lists a patch as seen at (x, y, z), and as near in all voxels that a cube of one voxel's size about it meets."""
    put(table, x, y, z, patch, True)
    half_m = 0.5 / table.inverse_m[0]
    for a in (-half_m, half_m):
        for b in (-half_m, half_m):
            for c in (-half_m, half_m):
                put(table, x + a, y + b, z + c, patch, False)


@lean_kernel()
def put_around(table: VoxelTable, x: float, y: float, z: float, patch: int) -> None:
    """Lists a patch as seen at (x, y, z), and as near in the 26 voxels around."""
    if is_listed(table, x, y, z, patch):
        return
    put(table, x, y, z, patch, True)
    edge_m = 1.0 / table.inverse_m[0]
    for a in range(-1, 2):
        for b in range(-1, 2):
            for c in range(-1, 2):
                if a != 0 or b != 0 or c != 0:
                    put(table, x + a * edge_m, y + b * edge_m, z + c * edge_m, patch, False)


@kernel()
def _copy(source: VoxelTable, target: VoxelTable) -> None:
    for i in range(len(source.keys)):
        if source.keys[i] != _EMPTY:
            slot = find_slot(target.keys, source.keys[i])
            target.keys[slot] = source.keys[i]
            target.lists[slot] = source.lists[i]
            target.hits[slot] = source.hits[i]
            target.num_used[0] += 1
