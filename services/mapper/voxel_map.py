"""The map: one averaged point a voxel, in a table that only grows, up to a bound."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.mapper.registration import Points
from services.mapper.state import VoxelsState
from services.mapper.voxel_table import VoxelTable
from shared.kernel import lean_kernel

_MAX_OBSERVATIONS = 20
"""A voxel is settled after this many points, which leaves 8 mm of noise at 2 mm; later points cannot make it drift."""


class VoxelMap:
    """Points in the map frame, thinned to the mean of the first points of each voxel.

    voxel_size_m: edge of a voxel. max_voxels: when so many are occupied, new places are no longer added.
    """

    def __init__(self, voxel_size_m: float, max_voxels: int) -> None:
        self._table = VoxelTable(voxel_size_m, max_voxels)
        self._sums = np.zeros((1024, 3))
        self._counts = np.zeros(1024, dtype=np.int32)

    def __len__(self) -> int:
        return len(self._table)

    @property
    def points_m(self) -> NDArray[np.float64]:
        """A copy of the map (N, 3), in the map frame, oldest voxel first."""
        num = len(self)
        return self._sums[:num] / self._counts[:num, np.newaxis]

    def snapshot(self) -> VoxelsState:
        """All voxels."""
        num = len(self)
        return VoxelsState(keys=self._table.keys, sums_m=self._sums[:num], counts=self._counts[:num])

    def restore(self, state: VoxelsState) -> None:
        """Takes voxels over, in place of its own.

        Raises:
            ValueError: they are too many, or one has no points.
        """
        if len(state.counts) and state.counts.min() < 1:
            raise ValueError("a voxel without points")
        self._table.restore(state.keys)
        self._sums, self._counts = np.zeros((1024, 3)), np.zeros(1024, dtype=np.int32)
        self._make_room()
        self._sums[: len(self)], self._counts[: len(self)] = state.sums_m, state.counts

    def insert(self, points_m: Points) -> None:
        """Adds points (N, 3) in the map frame. Those of one call that share a voxel count while it is not settled.

        Raises:
            ValueError: a point is too far from the origin to be numbered, see `VoxelTable`; nothing was added.
        """
        rows = self._table.rows(points_m)
        self._make_room()
        _accumulate(np.ascontiguousarray(points_m, dtype=np.float64), rows, _MAX_OBSERVATIONS, self._sums, self._counts)

    def _make_room(self) -> None:
        while len(self._table) > len(self._counts):
            self._sums = np.concatenate([self._sums, np.zeros_like(self._sums)])
            self._counts = np.concatenate([self._counts, np.zeros_like(self._counts)])


def voxel_centroids(points_m: Points, voxel_size_m: float) -> NDArray[np.float64]:
    """The mean (M, 3) of the points (N, 3) in each occupied voxel, in the order in which the voxels were first met.

    Raises:
        ValueError: a point is too far from the origin to be numbered, see `VoxelTable`.
    """
    points = np.ascontiguousarray(points_m, dtype=np.float64)
    table = VoxelTable(voxel_size_m, max_voxels=max(len(points), 1))
    rows = table.rows(points)
    sums, counts = np.zeros((len(table), 3)), np.zeros(len(table), dtype=np.int32)
    _accumulate(points, rows, len(points), sums, counts)
    centroids: NDArray[np.float64] = sums / counts[:, np.newaxis]
    return centroids


@lean_kernel()
def _accumulate(
    points: NDArray[np.float64],
    rows: NDArray[np.int32],
    max_observations: int,
    sums: NDArray[np.float64],
    counts: NDArray[np.int32],
) -> None:
    """Adds each point to its row, if it has one that is still open."""
    for i in range(len(points)):
        row = rows[i]
        if row >= 0 and counts[row] < max_observations:
            counts[row] += 1
            for axis in range(3):
                sums[row, axis] += points[i, axis]
