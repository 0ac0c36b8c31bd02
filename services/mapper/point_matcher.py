"""Finds scans by a point method: thins them, tries the guesses, searches wider where these fail, keeps the target."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from services.mapper.global_start import GlobalStart
from services.mapper.hypotheses import best_of
from services.mapper.keyframe_map import KeyframeMap, LastScan
from services.mapper.methods.registry import RegistrationClass
from services.mapper.registration import (
    MIN_POINTS,
    Points,
    Registration,
    RegistrationError,
    RegistrationResult,
    Surface,
    nothing_found,
)
from services.mapper.state import TargetState
from services.mapper.voxel_map import voxel_centroids
from shared.geometry import SE3
from shared.runtime.config import MapperConfig

_CLEAR_SCORE = 0.6
"""From here on no other pose is tried: a scan that slipped by 4 cm or more on a lattice stays below."""
ALIGNED_VOXELS = 1.5
"""Scans are aligned in voxels so many times as wide as those of the map, which is half the points.

Source: Vizzo et al., "KISS-ICP", RA-L 2023, which thins twice in this way.
"""
_SEARCH_STRIDE = 4
"""The first guess of a wider search takes every fourth point."""
_MAX_PLACES = 12
"""So many places of a lattice are tried to find a scan anew."""


class PointMatcher:
    """A `ScanMatcher` whose target is points: the map, or the last scan, as `scan_to` of the configuration says."""

    def __init__(self, config: MapperConfig, method: RegistrationClass) -> None:
        self._config = config
        self._method = method
        self._target: KeyframeMap | LastScan | None = None
        self._scan_m: Points = np.empty((0, 3))

    @property
    def target_points_m(self) -> NDArray[np.float64]:
        """What scans are aligned to (N, 3), in the map frame."""
        return np.empty((0, 3)) if self._target is None else self._target.points_m

    def start(self, points_lidar_m: Points, T_map_lidar: SE3) -> None:
        """Begins an empty target with this scan (N, 3), which is where it is said to be.

        Raises:
            RegistrationError: it has too few points.
        """
        kind = KeyframeMap if self._config.scan_to == "map" else LastScan
        self._target = kind(self._thin(points_lidar_m), T_map_lidar, self._config, self._method)

    def snapshot(self) -> TargetState:
        """The target."""
        return TargetState(points=self._started().snapshot())

    def restore(self, state: TargetState) -> None:
        """Goes on with a target.

        Raises:
            ValueError, RegistrationError: it cannot be one of these settings.
        """
        kind = KeyframeMap if self._config.scan_to == "map" else LastScan
        if (known := state.points) is None:
            raise ValueError("is no map of points")
        target = kind(known.points_m, SE3.identity(), self._config, self._method)
        target.restore(known)
        self._target = target

    def align(self, points_lidar_m: Points, guesses: Sequence[SE3], widening: float) -> RegistrationResult:
        """The first clear result of the attempts near the guesses, or the one of the highest score.

        Raises:
            RegistrationError: there is no target yet.
        """
        registration = self._started().registration
        self._scan_m = points_lidar_m
        thinned_m = voxel_centroids(points_lidar_m, ALIGNED_VOXELS * self._config.voxel_size_m)
        if len(thinned_m) < MIN_POINTS:
            return nothing_found(len(thinned_m), guesses[0])
        results = []
        for result in self._attempts(registration, thinned_m, guesses, widening):
            results.append(result)
            if result.is_converged and result.score >= _CLEAR_SCORE:
                return result
        return max(results, key=lambda result: result.score)

    def accept(self, T_map_lidar: SE3) -> None:
        """The scan aligned last was here: takes what it shows into the target.

        Raises:
            RegistrationError: there is no target yet.
        """
        target = self._started()
        thinned_m = self._thin(self._scan_m)
        if len(thinned_m) >= MIN_POINTS:
            target.add(thinned_m, T_map_lidar)

    def surfaces(self) -> list[Surface]:
        """None: points are no planes."""
        return []

    def localise(self, points_lidar_m: Points) -> RegistrationResult | None:
        """The best place of a scan (N, 3) anywhere in the target, from no guess; None where nothing fits.

        It is suspect where another place fits almost as well.

        Raises:
            RegistrationError: there is no target yet.
        """
        target_m = self._started().points_m
        thinned_m = voxel_centroids(points_lidar_m, ALIGNED_VOXELS * self._config.voxel_size_m)
        if len(thinned_m) < MIN_POINTS:
            return None
        candidates = GlobalStart(target_m, self._config.voxel_size_m).candidates(points_lidar_m, _MAX_PLACES)
        best = best_of(
            self._method(target_m, self._config),
            thinned_m,
            [candidate.T_map_lidar for candidate in candidates],
            self._config.max_correspondence_m,
        )
        return best if best is not None and best.score >= self._config.min_score else None

    def _attempts(
        self, registration: Registration, thinned_m: Points, guesses: Sequence[SE3], widening: float
    ) -> Iterator[RegistrationResult]:
        """From each guess with near pairs only; then from each with far pairs first."""
        gate_m = self._config.max_correspondence_m
        search_gate_m = self._config.search_correspondence_m * widening
        for guess in guesses:
            yield registration.align(thinned_m, guess, gate_m)
        for guess in guesses:
            coarse = registration.align(thinned_m[::_SEARCH_STRIDE], guess, search_gate_m)
            yield registration.align(thinned_m, coarse.T_map_lidar, gate_m)

    def _thin(self, points_lidar_m: Points) -> NDArray[np.float64]:
        return voxel_centroids(points_lidar_m, self._config.voxel_size_m)

    def _started(self) -> KeyframeMap | LastScan:
        if self._target is None:
            raise RegistrationError("there is no target to align to: start with a scan")
        return self._target
