"""Gives each occupied voxel a number: a hash table with open addressing, in arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.mapper.registration import Points
from shared.kernel import lean_kernel

_BITS = 21
_OFFSET = 1 << (_BITS - 1)
"""Three signed 21-bit coordinates fit one 64-bit key: at 0.05 m voxels, points within 52 km of the origin."""
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_EMPTY = -1
_MIN_CAPACITY = 512


class VoxelTable:
    """Voxels in the order in which they were first met, numbered from 0, at most `max_voxels` of them."""

    def __init__(self, voxel_size_m: float, max_voxels: int) -> None:
        self._voxel_size_m = voxel_size_m
        self._max_voxels = max_voxels
        self._num = 0
        self._keys = np.empty(0, dtype=np.int64)
        self._reserve(min(_MIN_CAPACITY, max_voxels))

    def __len__(self) -> int:
        return self._num

    @property
    def keys(self) -> NDArray[np.int64]:
        """Of the voxels (N,), in their order."""
        return self._keys[: self._num]

    def restore(self, keys: NDArray[np.int64]) -> None:
        """Numbers the voxels of these keys (N,), and no others.

        Raises:
            ValueError: they are too many, or one stands there twice.
        """
        if len(keys) > self._max_voxels or len(np.unique(keys)) < len(keys):
            raise ValueError(f"{len(keys)} voxels: must be different ones, and at most {self._max_voxels}")
        self._keys, self._num = keys.copy(), len(keys)
        self._reserve(min(max(_MIN_CAPACITY, 2 * len(keys)), self._max_voxels))

    def rows(self, points_m: Points) -> NDArray[np.int32]:
        """The voxel's number (N,) of each finite point (N, 3); new voxels get one while there is room, -1 without.

        Raises:
            ValueError: a point is 2^20 voxels or more from the origin; nothing was added.
        """
        keys = self._keys_of(points_m)
        needed = min(self._num + len(keys), self._max_voxels)
        if needed > len(self._keys):
            self._reserve(min(max(2 * len(self._keys), needed), self._max_voxels))
        rows = np.empty(len(keys), dtype=np.int32)
        self._num = _add(keys, self._slots, self._keys, self._num, rows)
        return rows

    def has(self, points_m: Points) -> NDArray[np.bool_]:
        """Whether the voxel of each finite point (N, 3) has a number (N,).

        Raises:
            ValueError: a point is 2^20 voxels or more from the origin.
        """
        keys = self._keys_of(points_m)
        is_known = np.empty(len(keys), dtype=np.bool_)
        _find(keys, self._slots, self._keys, is_known)
        return is_known

    def _keys_of(self, points_m: Points) -> NDArray[np.int64]:
        points = np.ascontiguousarray(points_m, dtype=np.float64)
        keys = np.empty(len(points), dtype=np.int64)
        if not _number_cells(points, self._voxel_size_m, keys):
            reach_m = np.abs(points).max()
            raise ValueError(f"points reach {reach_m:.0f} m: too far for voxels of {self._voxel_size_m} m")
        return keys

    def _reserve(self, capacity: int) -> None:
        """Room for `capacity` voxels, in at least twice as many slots, so that searches stay short."""
        known = self._keys[: self._num]
        self._keys = np.empty(capacity, dtype=np.int64)
        self._slots = np.full(1 << (2 * capacity).bit_length(), _EMPTY, dtype=np.int32)
        _add(known, self._slots, self._keys, 0, np.empty(len(known), dtype=np.int32))


@lean_kernel()
def _number_cells(points: NDArray[np.float64], voxel_size_m: float, keys: NDArray[np.int64]) -> bool:
    """Fills in one integer a point, the same for all points of one voxel; False if one is too far."""
    inverse = 1.0 / voxel_size_m
    for i in range(len(points)):
        key = 0
        for axis in range(3):
            cell = np.floor(points[i, axis] * inverse)
            if not abs(cell) < _OFFSET:
                return False
            key = (key << _BITS) | (int(cell) + _OFFSET)
        keys[i] = key
    return True


@lean_kernel()
def _slot_of(key: int, slots: NDArray[np.int32], keys: NDArray[np.int64]) -> int:
    """Where a key stands, or the free slot where it belongs (linear probing after Fibonacci hashing)."""
    mask = len(slots) - 1
    slot = int((np.uint64(key) * _GOLDEN) >> np.uint64(32)) & mask
    while slots[slot] != _EMPTY and keys[slots[slot]] != key:
        slot = (slot + 1) & mask
    return slot


@lean_kernel()
def _add(
    new_keys: NDArray[np.int64],
    slots: NDArray[np.int32],
    keys: NDArray[np.int64],
    num: int,
    rows: NDArray[np.int32],
) -> int:
    """Fills in the row of each key, and returns how many rows are then taken."""
    for i in range(len(new_keys)):
        if i > 0 and new_keys[i] == new_keys[i - 1]:
            rows[i] = rows[i - 1]
            continue
        slot = _slot_of(new_keys[i], slots, keys)
        if slots[slot] == _EMPTY and num < len(keys):
            slots[slot] = num
            keys[num] = new_keys[i]
            num += 1
        rows[i] = slots[slot]
    return num


@lean_kernel()
def _find(
    wanted: NDArray[np.int64], slots: NDArray[np.int32], keys: NDArray[np.int64], is_known: NDArray[np.bool_]
) -> None:
    """Fills in which keys are in the table."""
    for i in range(len(wanted)):
        is_known[i] = slots[_slot_of(wanted[i], slots, keys)] != _EMPTY
