"""What scans are aligned to: a map that grows by keyframes, or the last scan alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.mapper.methods.registry import RegistrationClass
from services.mapper.registration import MIN_POINTS, Points, Registration
from services.mapper.state import PointsState
from services.mapper.voxel_map import VoxelMap
from shared.geometry import SE3
from shared.runtime.config import MapperConfig


class KeyframeMap:
    """A voxel map of keyframes: the first scan, and those that show more.

    registration: aligns scans to the map as of the last keyframe, out to twice the sensor's range from there; to all of
    it where a full map has nothing there.

    Raises:
        RegistrationError: the first scan has too few points.
    """

    def __init__(
        self, points_lidar_m: Points, T_map_lidar: SE3, config: MapperConfig, method: RegistrationClass
    ) -> None:
        self._config = config
        self._method = method
        self._voxels = VoxelMap(config.voxel_size_m, config.max_map_points)
        self._insert(points_lidar_m, T_map_lidar)

    def snapshot(self) -> PointsState:
        """The voxels, and around where scans are aligned to them."""
        return PointsState(
            points_m=self.points_m, voxels=self._voxels.snapshot(), near_m=self._near_m[None], novelty=self._novelty
        )

    def restore(self, state: PointsState) -> None:
        """Takes the voxels of a snapshot over, in place of its own.

        Raises:
            ValueError: it cannot be one of these settings.
        """
        if state.voxels is None or len(state.near_m) != 1:
            raise ValueError("is no map of keyframes")
        self._voxels.restore(state.voxels)
        self._aim(state.near_m[0])
        self._novelty = state.novelty

    @property
    def points_m(self) -> NDArray[np.float64]:
        """A copy of the map (N, 3), in the map frame."""
        return self._voxels.points_m

    def add(self, points_lidar_m: Points, T_map_lidar: SE3) -> None:
        """Takes a located scan (N, 3); it becomes a keyframe if the map has failed to explain enough since the last.

        What a single scan shows is not lost for being small: unexplained shares add up until they are let in.
        """
        distances_m = self.registration.distances(T_map_lidar.apply(points_lidar_m))
        self._novelty += float(np.mean(distances_m > self._config.max_correspondence_m))
        if self._novelty > self._config.keyframe_novelty:
            self._insert(points_lidar_m, T_map_lidar)

    def _insert(self, points_lidar_m: Points, T_map_lidar: SE3) -> None:
        self._voxels.insert(T_map_lidar.apply(points_lidar_m))
        self._novelty = 0.0
        self._aim(T_map_lidar.translation)

    def _aim(self, near_m: NDArray[np.float64]) -> None:
        self._near_m = near_m
        points_m = self._voxels.points_m
        target_m = in_reach(points_m, near_m, self._config)
        self.registration: Registration = self._method(target_m, self._config)


class LastScan:
    """The last scan alone, as a target: what was seen before is forgotten.

    Raises:
        RegistrationError: the first scan has too few points.
    """

    def __init__(
        self, points_lidar_m: Points, T_map_lidar: SE3, config: MapperConfig, method: RegistrationClass
    ) -> None:
        self._config = config
        self._method = method
        self.add(points_lidar_m, T_map_lidar)

    def snapshot(self) -> PointsState:
        """The scan."""
        return PointsState(points_m=self._points_m, voxels=None, near_m=np.empty((0, 3)), novelty=0.0)

    def restore(self, state: PointsState) -> None:
        """Nothing besides the scan it was begun with."""

    @property
    def points_m(self) -> NDArray[np.float64]:
        """The scan (N, 3), in the map frame."""
        return self._points_m

    def add(self, points_lidar_m: Points, T_map_lidar: SE3) -> None:
        """Takes a located scan (N, 3) in place of the one before."""
        self._points_m = np.asarray(T_map_lidar.apply(points_lidar_m), dtype=np.float64)
        self.registration: Registration = self._method(self._points_m, self._config)


def in_reach(points_m: NDArray[np.float64], near_m: NDArray[np.float64], config: MapperConfig) -> NDArray[np.float64]:
    """Those points (N, 3) within twice the sensor's range of a place (3,); all, where there are too few."""
    is_near = np.linalg.norm(points_m - near_m, axis=1) <= 2.0 * config.max_range_m
    return points_m[is_near] if is_near.sum() >= MIN_POINTS else points_m
