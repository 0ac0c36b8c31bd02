"""Aligns scans to the map's cloud by points: where planes leave a direction open, the ends of their faces tell."""

from __future__ import annotations

import numpy as np

from services.mapper.keyframe_map import in_reach
from services.mapper.methods.registry import registration_class
from services.mapper.point_matcher import ALIGNED_VOXELS
from services.mapper.registration import MIN_POINTS, Points, Registration, RegistrationResult
from services.mapper.voxel_map import VoxelMap, voxel_centroids
from shared.geometry import SE3
from shared.runtime.config import MapperConfig

_METHOD = "gicp"
_GROWTH = 1.05
"""The target is made anew when the cloud has grown by so much."""
_MAX_WAY = 0.5
"""And when the sensor has gone this share of its range since."""


class CloudAlignment:
    """A target of points that is made when it is asked for, since most scans need none.

    voxels: the map's cloud, in the map frame, which grows meanwhile.
    """

    def __init__(self, config: MapperConfig, voxels: VoxelMap) -> None:
        self._config, self._voxels = config, voxels
        self._method = registration_class(_METHOD)
        self._registration: Registration | None = None
        self._num_points = 0
        self._at_m = np.zeros(3)

    def align(self, points_m: Points, T_map_sensor: SE3) -> RegistrationResult | None:
        """The place of a scan (N, 3), in the sensor's frame, near a pose; None where it does not fit the cloud."""
        thinned_m = voxel_centroids(points_m, ALIGNED_VOXELS * self._config.voxel_size_m)
        if len(thinned_m) < MIN_POINTS or len(self._voxels) < MIN_POINTS:
            return None
        registration = self._target(T_map_sensor)
        result = registration.align(thinned_m, T_map_sensor, self._config.max_correspondence_m)
        return result if result.is_converged and result.score >= self._config.min_score else None

    def _target(self, T_map_sensor: SE3) -> Registration:
        way_m = float(np.linalg.norm(T_map_sensor.translation - self._at_m))
        is_old = len(self._voxels) > _GROWTH * self._num_points or way_m > _MAX_WAY * self._config.max_range_m
        if self._registration is None or is_old:
            points_m = self._voxels.points_m
            self._num_points, self._at_m = len(points_m), T_map_sensor.translation
            self._registration = self._method(in_reach(points_m, self._at_m, self._config), self._config)
        return self._registration
