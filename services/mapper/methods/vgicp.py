"""Voxelised GICP: each point is paired with the normal distribution of the voxel it falls into, without a search."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import small_gicp

from services.mapper.methods.iterative import IterativeRegistration
from services.mapper.registration import Points
from shared.geometry import SE3
from shared.runtime.config import MapperConfig

_MIN_VOXELS = 2.0
"""Edge of the distributions' voxels, at least so many of the voxels that thin the target."""
_MAX_VOXEL_SIZE_M = 0.5
"""Larger ones hold several bars."""


class Vgicp(IterativeRegistration):
    """The voxels are as wide as pairs may be apart, so that a wider search takes coarser ones.

    Source: Koide et al., "Voxelized GICP for fast and accurate 3D point cloud registration", ICRA 2021.
    """

    def __init__(self, target_map_m: Points, config: MapperConfig) -> None:
        super().__init__(target_map_m, config)
        self._voxels = lru_cache(maxsize=4)(self._make_voxels)

    def _iterate(self, source: small_gicp.PointCloud, T_map_lidar: SE3, max_correspondence_m: float) -> Any:
        self._estimate_shapes(source)
        voxel_size_m = min(max_correspondence_m, _MAX_VOXEL_SIZE_M)
        voxel_size_m = max(voxel_size_m, _MIN_VOXELS * self._config.voxel_size_m)
        return small_gicp.align(
            self._voxels(voxel_size_m),
            source,
            T_map_lidar.matrix,
            max_correspondence_distance=max_correspondence_m,
            **self._limits,
        )

    def _make_voxels(self, voxel_size_m: float) -> small_gicp.GaussianVoxelMap:
        voxels = small_gicp.GaussianVoxelMap(voxel_size_m)
        voxels.insert(self._surface.cloud)
        return voxels
