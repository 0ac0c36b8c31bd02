"""Two steps: the planes of scan and target are laid on each other, then GICP brings the points together."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.mapper.global_start import GlobalStart
from services.mapper.hypotheses import best_of
from services.mapper.methods.gicp import Gicp
from services.mapper.registration import MIN_POINTS, Points, RegistrationResult, nothing_found
from shared.geometry import SE3
from shared.runtime.config import MapperConfig


class TwoStep:
    """Registration (see `Registration`) from guesses too far off for pairs of nearest points.

    Raises:
        RegistrationError: fewer than MIN_POINTS target points.
    """

    max_angle_rad = np.deg2rad(60.0)
    max_distance_m = 1.5
    """Planes are matched within these of the predicted pose."""
    max_candidates = 5

    def __init__(self, target_map_m: Points, config: MapperConfig) -> None:
        self._gicp = Gicp(target_map_m, config)
        self._start = GlobalStart(target_map_m, config.voxel_size_m)

    def align(self, points_lidar_m: Points, T_map_lidar: SE3, max_correspondence_m: float) -> RegistrationResult:
        """Aligns a scan (N, 3) in the lidar frame, from the predicted pose, with pairs up to `max_correspondence_m`.

        The prediction is one of the poses tried. The result is suspect where another pose scores almost as high.
        """
        if len(points_lidar_m) < MIN_POINTS:
            return nothing_found(len(points_lidar_m), T_map_lidar)
        candidates = self._start.candidates(
            points_lidar_m, self.max_candidates, T_map_lidar, self.max_angle_rad, self.max_distance_m
        )
        starts = [T_map_lidar, *(candidate.T_map_lidar for candidate in candidates)]
        best = best_of(self._gicp, points_lidar_m, starts, max_correspondence_m)
        return nothing_found(len(points_lidar_m), T_map_lidar) if best is None else best

    def distances(self, points_map_m: Points) -> NDArray[np.float64]:
        """Distance (N,) in metres from each point (N, 3) in the map frame to the nearest of the target."""
        return self._gicp.distances(points_map_m)
