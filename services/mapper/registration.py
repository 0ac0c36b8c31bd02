"""What every registration method offers: it aligns scans to a target cloud of the map."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from shared.geometry import SE3

Points = NDArray[np.floating]

_SURFACE_TOLERANCE_M = 0.01
"""Inliers this far off their surfaces count half: good registrations have 3-5 mm, slipped ones mostly 7-14 mm."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RegistrationResult:
    """Where a scan was found in the map.

    is_converged: the last step was below the method's threshold. num_points: of the scan. num_inliers: those with a
    target point within the correspondence gate; fitness_m2: the mean square of their distances along the surfaces'
    normals, None without inliers. hessian: (6, 6) of half the sum of these squares, for a step of translation in
    metres, then rotation in radians about the lidar, along the map's axes.
    """

    T_map_lidar: SE3
    is_converged: bool
    num_iterations: int
    num_points: int
    num_inliers: int
    fitness_m2: float | None
    hessian: NDArray[np.float64]

    @property
    def score(self) -> float:
        """Share of the scan that the target explains, 0..1, discounted as the inliers lie off their surfaces."""
        if self.fitness_m2 is None:
            return 0.0
        return self.num_inliers / self.num_points / (1.0 + self.fitness_m2 / _SURFACE_TOLERANCE_M**2)


class Registration(Protocol):
    """A method, built on the target cloud (M, 3) it aligns to, which is in the map frame."""

    def align(self, points_lidar_m: Points, T_map_lidar: SE3, max_correspondence_m: float) -> RegistrationResult:
        """Aligns a scan (N, 3) in the lidar frame, from the predicted pose, with pairs up to `max_correspondence_m`."""

    def distances(self, points_map_m: Points) -> NDArray[np.float64]:
        """Distance (N,) in metres from each point (N, 3) in the map frame to the nearest of the target."""
