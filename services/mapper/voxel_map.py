"""The map: one averaged point a voxel, in a table that only grows, up to a bound."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.mapper.filters import voxel_keys
from services.mapper.registration import Points

_MAX_OBSERVATIONS = 20
"""A voxel is settled after this many points, which leaves 8 mm of noise at 2 mm; later points cannot make it drift."""


class VoxelMap:
    """Points in the map frame, thinned to the mean of the first points of each voxel.

    voxel_size_m: edge of a voxel. max_voxels: when so many are occupied, new places are no longer added.
    """

    def __init__(self, voxel_size_m: float, max_voxels: int) -> None:
        self._voxel_size_m = voxel_size_m
        self._max_voxels = max_voxels
        self._row_of_key: dict[int, int] = {}
        self._sums = np.zeros((1024, 3))
        self._counts = np.zeros(1024, dtype=np.int64)

    def __len__(self) -> int:
        return len(self._row_of_key)

    @property
    def points_m(self) -> NDArray[np.float64]:
        """A copy of the map (N, 3), oldest voxel first."""
        num = len(self)
        return self._sums[:num] / self._counts[:num, np.newaxis]

    def insert(self, points_m: Points) -> None:
        """Adds points (N, 3) in the map frame.

        Raises:
            ValueError: a point is too far from the origin to be numbered, see `voxel_keys`.
        """
        rows = self._rows(voxel_keys(points_m, self._voxel_size_m))
        is_open = (rows >= 0) & (self._counts[rows] < _MAX_OBSERVATIONS)
        np.add.at(self._sums, rows[is_open], points_m[is_open])
        np.add.at(self._counts, rows[is_open], 1)

    def _rows(self, keys: NDArray[np.int64]) -> NDArray[np.int64]:
        """The row of each key, giving new keys a row while there is room; -1 without one."""
        table = self._row_of_key
        for key in keys.tolist():
            if key not in table and len(table) < self._max_voxels:
                table[key] = len(table)
        while len(table) > len(self._counts):
            self._sums = np.concatenate([self._sums, np.zeros_like(self._sums)])
            self._counts = np.concatenate([self._counts, np.zeros_like(self._counts)])
        return np.array([table.get(key, -1) for key in keys.tolist()], dtype=np.int64)
