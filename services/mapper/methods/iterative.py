"""What small_gicp's registrations have in common: the target is a surface, the scan is moved onto it step by step."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
import small_gicp
from numpy.typing import NDArray

from services.mapper.methods.surface import NUM_NEIGHBOURS, Surface
from services.mapper.registration import MIN_POINTS, Points, RegistrationResult, nothing_found
from shared.geometry import SE3
from shared.runtime.config import MapperConfig

_ROTATION_EPSILON_RAD = 1e-3
_TRANSLATION_EPSILON_M = 1e-3
"""A step below these ends the iteration: Gauss-Newton steps that small leave a tenth of a millimetre."""


class IterativeRegistration(ABC):
    """Registration (see `Registration`) to target points (M, 3) in the map frame; a subclass says how a step is found.

    Source: Koide, "small_gicp", JOSS 2024.

    Raises:
        RegistrationError: fewer than MIN_POINTS target points.
    """

    def __init__(self, target_map_m: Points, config: MapperConfig) -> None:
        self._config = config
        self._surface = Surface(target_map_m, config.num_threads)

    def align(self, points_lidar_m: Points, T_map_lidar: SE3, max_correspondence_m: float) -> RegistrationResult:
        """Aligns a scan (N, 3) in the lidar frame, from the predicted pose, with pairs up to `max_correspondence_m`."""
        if len(points_lidar_m) < MIN_POINTS:
            return nothing_found(len(points_lidar_m), T_map_lidar)
        found = self._iterate(small_gicp.PointCloud(points_lidar_m), T_map_lidar, max_correspondence_m)
        return self._surface.fit(
            points_lidar_m,
            SE3.projected(found.T_target_source),
            max_correspondence_m,
            is_converged=bool(found.converged),
            num_iterations=int(found.iterations),
        )

    def distances(self, points_map_m: Points) -> NDArray[np.float64]:
        """Distance (N,) in metres from each point (N, 3) in the map frame to the nearest of the target."""
        return self._surface.distances(points_map_m)

    @abstractmethod
    def _iterate(self, source: small_gicp.PointCloud, T_map_lidar: SE3, max_correspondence_m: float) -> Any:
        """small_gicp's result of aligning the source to the target."""

    def _align_to_points(
        self, source: small_gicp.PointCloud, T_map_lidar: SE3, max_correspondence_m: float, kind: str
    ) -> Any:
        """small_gicp's registration `kind` with the target point nearest to each point of the source."""
        return small_gicp.align(
            self._surface.cloud,
            source,
            self._surface.tree,
            T_map_lidar.matrix,
            registration_type=kind,
            max_correspondence_distance=max_correspondence_m,
            **self._limits,
        )

    def _estimate_shapes(self, source: small_gicp.PointCloud) -> None:
        small_gicp.estimate_covariances(source, None, NUM_NEIGHBOURS, self._config.num_threads)

    @property
    def _limits(self) -> dict[str, float]:
        return {
            "num_threads": self._config.num_threads,
            "max_iterations": self._config.max_iterations,
            "rotation_epsilon": _ROTATION_EPSILON_RAD,
            "translation_epsilon": _TRANSLATION_EPSILON_M,
        }
