"""Follows the lidar from scan to scan: predicts, registers, searches wider where that fails, and decides."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from services.mapper.registration import Points, Registration, RegistrationResult
from shared.geometry import SE3
from shared.runtime.config import MapperConfig

MIN_POINTS = 20
"""A thinned scan with fewer points is not registered: the local shape of one point alone takes ten."""
_CLEAR_SCORE = 0.75
"""From here on no other pose is tried: on lattices, wrong poses that had converged stayed below."""
_SEARCH_STRIDE = 4
"""The first guess of a wider search takes every fourth point."""
_MAX_WIDENINGS = 3
"""What is searched and believed doubles with each lost scan, so often at most."""


@dataclass(frozen=True, slots=True)
class Track:
    """Where the lidar is believed to be. result: the registration behind it, None if there was nothing to register."""

    T_map_lidar: SE3
    is_tracking: bool
    result: RegistrationResult | None


class Tracker:
    """Predicts by constant velocity and corrects by registration; begins at rest at the map's origin, at `stamp_ns`.

    A lost scan keeps the prediction, and the velocity is dropped, so that the estimate does not run away.
    """

    def __init__(self, config: MapperConfig, stamp_ns: int) -> None:
        self._config = config
        self._stamp_ns = self._tracked_stamp_ns = stamp_ns
        self._T_map_lidar = self._T_map_tracked = SE3.identity()
        self._twist_per_s = np.zeros(6)
        self._num_lost = 0

    def follow(self, points_lidar_m: Points, stamp_ns: int, registration: Registration) -> Track:
        """Finds the thinned scan (N, 3), in the lidar frame, in the registration's target."""
        prediction = self._T_map_lidar @ SE3.exp(self._twist_per_s * _seconds(stamp_ns - self._stamp_ns))
        self._stamp_ns = stamp_ns
        has_points = len(points_lidar_m) >= MIN_POINTS
        result = self._best(points_lidar_m, prediction, registration) if has_points else None
        if result is not None and self._is_believable(result, prediction):
            self._accept(result.T_map_lidar)
            return Track(result.T_map_lidar, True, result)
        self._T_map_lidar = prediction
        self._twist_per_s = np.zeros(6)
        self._num_lost += 1
        return Track(prediction, False, result)

    def _best(self, points_lidar_m: Points, prediction: SE3, registration: Registration) -> RegistrationResult:
        """The first clear result of the attempts, or the one of the highest score."""
        results = []
        for result in self._attempts(points_lidar_m, prediction, registration):
            results.append(result)
            if result.is_converged and result.score >= _CLEAR_SCORE:
                return result
        return max(results, key=lambda result: result.score)

    def _attempts(
        self, points_lidar_m: Points, prediction: SE3, registration: Registration
    ) -> Iterator[RegistrationResult]:
        gate_m = self._config.max_correspondence_m
        search_gate_m = self._config.search_correspondence_m * self._widening
        for start in (prediction, self._T_map_tracked):
            yield registration.align(points_lidar_m, start, gate_m)
        for start in (prediction, self._T_map_tracked):
            guess = registration.align(points_lidar_m[::_SEARCH_STRIDE], start, search_gate_m)
            yield registration.align(points_lidar_m, guess.T_map_lidar, gate_m)

    def _is_believable(self, result: RegistrationResult, prediction: SE3) -> bool:
        jumps = [start.inv() @ result.T_map_lidar for start in (prediction, self._T_map_tracked)]
        return result.score >= self._config.min_score and any(
            np.linalg.norm(jump.translation) <= self._config.max_jump_m * self._widening
            and jump.angle_rad <= np.deg2rad(self._config.max_jump_deg) * self._widening
            for jump in jumps
        )

    def _accept(self, T_map_lidar: SE3) -> None:
        elapsed_s = _seconds(self._stamp_ns - self._tracked_stamp_ns)
        step = self._T_map_tracked.inv() @ T_map_lidar
        self._twist_per_s = step.log() / elapsed_s if elapsed_s > 0 else np.zeros(6)
        self._T_map_lidar = self._T_map_tracked = T_map_lidar
        self._tracked_stamp_ns = self._stamp_ns
        self._num_lost = 0

    @property
    def _widening(self) -> float:
        return float(2 ** min(self._num_lost, _MAX_WIDENINGS))


def _seconds(duration_ns: int) -> float:
    return duration_ns * 1e-9
