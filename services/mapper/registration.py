"""What registration methods offer, and what they say of a result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from services.mapper.state import TargetState
from shared.errors import HyrecroError
from shared.geometry import SE3

Points = NDArray[np.floating]

MIN_POINTS = 20
"""A cloud with fewer thinned points is not registered: the local shape of one point alone takes ten."""


class RegistrationError(HyrecroError):
    """A scan has too little to align others to, or was not found: the text says which."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RegistrationResult:
    """Where a scan was found in its target.

    is_converged: the last step was below the method's threshold. num_points: of the scan, as the method took it.
    num_inliers: those with something of the target within the gate; fitness_m2: the mean square of their distances to
    it, None without inliers. score: 0..1, how well the target explains the scan. hessian: (6, 6) of half the sum of the
    squared distances along the surfaces' normals, in m^2, for a step of translation in metres, then rotation in radians
    about the lidar, along the map's axes. is_suspect: the pose fits, but another one a step away along a weak direction
    would fit as well: it may be wrong. sigma_m: standard deviation of those distances, where the method knows it.
    """

    T_map_lidar: SE3
    is_converged: bool
    num_iterations: int
    num_points: int
    num_inliers: int
    fitness_m2: float | None
    score: float
    hessian: NDArray[np.float64]
    is_suspect: bool = False
    sigma_m: float | None = None


def surface_score(num_inliers: int, num_points: int, variance_m2: float | None, tolerance_m: float) -> float:
    """Share of the scan that the target explains, 0..1, discounted as the inliers lie off their surfaces.

    variance_m2: the mean square of the inliers' distances along the surfaces' normals; None without inliers. Inliers
    that are `tolerance_m` off count half.
    """
    if variance_m2 is None or num_points == 0:
        return 0.0
    return num_inliers / num_points / (1.0 + variance_m2 / tolerance_m**2)


def nothing_found(num_points: int, T_map_lidar: SE3) -> RegistrationResult:
    """The result where a scan has too few points, or nothing of it is explained: the guess, with score 0."""
    return RegistrationResult(
        T_map_lidar=T_map_lidar,
        is_converged=False,
        num_iterations=0,
        num_points=num_points,
        num_inliers=0,
        fitness_m2=None,
        score=0.0,
        hessian=np.zeros((6, 6)),
    )


class Registration(Protocol):
    """A point method, built on the target cloud (M, 3) it aligns to, which is in the map frame."""

    def align(self, points_lidar_m: Points, T_map_lidar: SE3, max_correspondence_m: float) -> RegistrationResult:
        """Aligns a scan (N, 3) in the lidar frame, from the predicted pose, with pairs up to `max_correspondence_m`."""

    def distances(self, points_map_m: Points) -> NDArray[np.float64]:
        """Distance (N,) in metres from each point (N, 3) in the map frame to the nearest of the target."""


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """A plane of the target, in the map frame. plane (4,): unit normal towards the side it was seen from, then offset.

    id: stays the same while the surface is refined. outline_m (K, 3): corners of the part that was seen,
    counter-clockwise seen from that side. patch_ids (P,): the patches it is joined of.
    """

    id: int
    patch_ids: NDArray[np.int64]
    plane: NDArray[np.float64]
    num_points: int
    outline_m: NDArray[np.float64]


class ScanMatcher(Protocol):
    """Finds scans in a target of its own, which it grows from the scans that were believed.

    Scans are points (N, 3) in the lidar frame, filtered but not thinned, in the order in which they were measured.
    """

    def start(self, points_lidar_m: Points, T_map_lidar: SE3) -> None:
        """Begins an empty target with this scan, which is where it is said to be.

        Raises:
            RegistrationError: the scan has too little to align others to.
        """

    def align(self, points_lidar_m: Points, guesses: Sequence[SE3], widening: float) -> RegistrationResult:
        """The best place of a scan near the guesses of T_map_lidar, the most likely first; searches wider as needed.

        widening: 1, 2, 4, 8 times the usual way from a guess are searched.
        """

    def accept(self, T_map_lidar: SE3) -> None:
        """The scan aligned last was here: takes what it shows into the target."""

    def localise(self, points_lidar_m: Points) -> RegistrationResult | None:
        """The best place of a scan anywhere in the target, from no guess; None where nothing fits."""

    def snapshot(self) -> TargetState:
        """The target, which `restore` of a matcher of the same settings takes."""

    def restore(self, state: TargetState) -> None:
        """Goes on with a target.

        Raises:
            ValueError, RegistrationError: it cannot be one of these settings.
        """

    def surfaces(self) -> list[Surface]:
        """The planes of the target; none where the method knows none."""
