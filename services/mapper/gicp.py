"""Generalised ICP by small_gicp: distances weighted by the local shape of both clouds.

Source: Segal, Haehnel, Thrun, "Generalized-ICP", RSS 2009; Koide, "small_gicp", JOSS 2024.
"""

from __future__ import annotations

import numpy as np
import small_gicp
from numpy.typing import NDArray

from services.mapper.registration import Points, RegistrationResult
from shared.geometry import SE3
from shared.runtime.config import MapperConfig

_NUM_NEIGHBOURS = 10
"""From which a point's local shape is estimated, as small_gicp's own preprocessing does."""
_PAIR_VARIANCE = 2e-3
"""small_gicp flattens every local shape to 1, 1 and 1e-3 (along the normal); a pair of them adds up to this."""
_ROTATION_EPSILON_RAD = 1e-4
_TRANSLATION_EPSILON_M = 1e-4
"""A step below these ends the iteration: a tenth of the error that is aimed at."""


class Gicp:
    """GICP of scans to a kd-tree of the target points (M, 3), which are in the map frame."""

    def __init__(self, target_map_m: Points, config: MapperConfig) -> None:
        self._max_iterations = config.max_iterations
        self._num_threads = config.num_threads
        self._target = small_gicp.PointCloud(target_map_m)
        self._tree = small_gicp.KdTree(self._target, self._num_threads)
        small_gicp.estimate_covariances(self._target, self._tree, _NUM_NEIGHBOURS, self._num_threads)

    def align(self, points_lidar_m: Points, T_map_lidar: SE3, max_correspondence_m: float) -> RegistrationResult:
        """Aligns a scan (N, 3) in the lidar frame, from the predicted pose, with pairs up to `max_correspondence_m`."""
        source = small_gicp.PointCloud(points_lidar_m)
        small_gicp.estimate_covariances(source, None, _NUM_NEIGHBOURS, self._num_threads)
        found = small_gicp.align(
            self._target,
            source,
            self._tree,
            T_map_lidar.matrix,
            registration_type="GICP",
            max_correspondence_distance=max_correspondence_m,
            num_threads=self._num_threads,
            max_iterations=self._max_iterations,
            rotation_epsilon=_ROTATION_EPSILON_RAD,
            translation_epsilon=_TRANSLATION_EPSILON_M,
        )
        T = SE3.projected(found.T_target_source)
        num_inliers = int(found.num_inliers)
        return RegistrationResult(
            T_map_lidar=T,
            is_converged=bool(found.converged),
            num_iterations=int(found.iterations),
            num_points=len(points_lidar_m),
            num_inliers=num_inliers,
            fitness_m2=2.0 * _PAIR_VARIANCE * found.error / num_inliers if num_inliers else None,
            hessian=_PAIR_VARIANCE * _in_map_axes(found.H, T),
        )

    def distances(self, points_map_m: Points) -> NDArray[np.float64]:
        """Distance (N,) in metres from each point (N, 3) in the map frame to the nearest of the target."""
        _, squares = self._tree.batch_nearest_neighbor_search(points_map_m, self._num_threads)
        distances: NDArray[np.float64] = np.sqrt(squares)
        return distances


def _in_map_axes(hessian: NDArray[np.float64], T_map_lidar: SE3) -> NDArray[np.float64]:
    """small_gicp's step is rotation, then translation, along the lidar's axes: reordered and turned to the map's."""
    turn = np.zeros((6, 6))
    turn[:3, 3:] = turn[3:, :3] = T_map_lidar.rotation
    turned: NDArray[np.float64] = turn @ hessian @ turn.T
    return turned
