"""Follows the sensor from scan to scan: aligns, believes or does not, holds what is open, finds itself again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from services.mapper.cloud_alignment import CloudAlignment
from services.mapper.degeneracy import degenerate_axes, held
from services.mapper.registration import Points, RegistrationResult, ScanMatcher
from shared.geometry import SE3
from shared.runtime.config import MapperConfig

_MAX_WIDENINGS = 3
"""What is searched and believed doubles with each lost scan, so often at most."""
_MEASURED = 0.25
"""Of what is searched and believed without a measurement of the motion; legs are wrong by centimetres."""
_JUST_THERE_M, _JUST_THERE_RAD = 0.03, 0.035
"""What a measured step may be wrong by and still tell two places apart: slips along weak directions are 4-12 cm."""
_SEEMING = 0.5
"""Of the score that is believed: enough to try how a scan fits, or where a measured motion says the same."""
_LOCALISE_AFTER = 2
"""Lost scans after which the whole map is searched, at first at each and then at every so many scans."""
_LOCALISE_EVERY = 5
_MAX_DOUBLINGS = 20
"""Of the way that is believed after a search of the whole map: by then any place is."""


@dataclass(frozen=True, slots=True)
class Track:
    """Where the sensor is believed to be. result: the registration behind it, None if there was nothing to register.

    degenerate_axes: of the map, which the scan leaves open, so that the prediction holds the pose there.
    is_found_again: the pose was found by a search of the whole map.
    """

    T_map_sensor: SE3
    is_tracking: bool
    result: RegistrationResult | None = None
    degenerate_axes: tuple[str, ...] = ()
    is_found_again: bool = False


class Tracker:
    """Believes or refuses what a matcher finds. A refused scan is lost: its pose is the prediction, the map unchanged.

    matcher: has begun its target. T_map_sensor: where the last scan was taken. cloud: what is asked where a scan leaves
    directions open that no measurement of the motion holds. T_map_tracked: the last that was tracked, by default the
    same; num_lost: scans lost since.
    """

    def __init__(
        self,
        config: MapperConfig,
        matcher: ScanMatcher,
        T_map_sensor: SE3,
        cloud: CloudAlignment | None = None,
        *,
        T_map_tracked: SE3 | None = None,
        num_lost: int = 0,
    ) -> None:
        self._config = config
        self._matcher = matcher
        self._cloud = cloud
        self._T_map_sensor, self._T_map_tracked = T_map_sensor, T_map_tracked or T_map_sensor
        self.num_lost = num_lost
        """Scans lost since the last that was tracked."""

    @property
    def T_map_sensor(self) -> SE3:
        """Where the last scan was believed to be taken."""
        return self._T_map_sensor

    @property
    def T_map_tracked(self) -> SE3:
        """Where the last scan that was not lost was taken."""
        return self._T_map_tracked

    def look(self, points_m: Points, step: SE3) -> SE3 | None:
        """Where a scan seems to be near the prediction; nothing is believed or taken from it.

        A scan that is bent otherwise than was thought fits badly everywhere, but least so where it was taken.
        """
        prediction = self._T_map_sensor @ step
        guesses = [prediction, self._T_map_tracked]
        widening = self._widening(is_measured=False)
        result = self._matcher.align(points_m, guesses, widening)
        is_found = result.score >= _SEEMING * self._config.min_score and self._is_near(result, guesses, widening)
        return result.T_map_lidar if is_found else None

    def follow(self, points_m: Points, step: SE3, *, is_measured: bool = False) -> Track:
        """Finds a filtered scan (N, 3), in the sensor's frame, in the map. step: T_last_now as predicted.

        is_measured: the step comes from a measurement of the motion rather than from its trend. Then only its end is
        searched, less far, and a place that is just there is believed even where another would fit as well, or where
        much of the scan is new.
        """
        prediction = self._T_map_sensor @ step
        guesses = [prediction] if is_measured else [prediction, self._T_map_tracked]
        widening = self._widening(is_measured)
        result = self._matcher.align(points_m, guesses, widening)
        is_found_again = False
        if not (self._is_clear(result, prediction, is_measured) and self._is_near(result, guesses, widening)):
            result, is_found_again = self._found_anywhere(points_m, guesses, is_measured) or (result, False)
            if not is_found_again:
                self._T_map_sensor = prediction
                self.num_lost += 1
                return Track(prediction, False, result, degenerate_axes(result.hessian))
        T_map_sensor, axes = result.T_map_lidar, degenerate_axes(result.hessian)
        if axes and not is_found_again:
            T_map_sensor, axes = self._held(points_m, result, prediction, is_measured)
        self._matcher.accept(T_map_sensor)
        self._T_map_sensor = self._T_map_tracked = T_map_sensor
        self.num_lost = 0
        return Track(T_map_sensor, True, result, axes, is_found_again)

    def _held(
        self, points_m: Points, result: RegistrationResult, prediction: SE3, is_measured: bool
    ) -> tuple[SE3, tuple[str, ...]]:
        """The pose, with its open directions held by what knows best, and the axes that are open still."""
        T_map_sensor, axes = held(result, prediction), degenerate_axes(result.hessian)
        if is_measured or self._cloud is None:
            return T_map_sensor, axes
        found = self._cloud.align(points_m, T_map_sensor)
        if found is None:
            return T_map_sensor, axes
        still_open = degenerate_axes(found.hessian)
        return held(result, held(found, prediction)), tuple(axis for axis in axes if axis in still_open)

    def _widening(self, is_measured: bool) -> float:
        widest = 2.0 ** min(self.num_lost, _MAX_WIDENINGS)
        return min(_MEASURED * widest, 1.0) if is_measured else widest

    def _is_clear(self, result: RegistrationResult, prediction: SE3, is_measured: bool) -> bool:
        if is_measured and _is_at(result.T_map_lidar, prediction):
            return result.score >= _SEEMING * self._config.min_score
        return result.score >= self._config.min_score and not result.is_suspect

    def _found_anywhere(
        self, points_m: Points, guesses: list[SE3], is_measured: bool
    ) -> tuple[RegistrationResult, bool] | None:
        """A clear place in the whole map, not farther than so many lost scans allow: lattices repeat themselves."""
        since = self.num_lost - _LOCALISE_AFTER
        if self._config.scan_to == "scan" or since < 0 or (since > _LOCALISE_EVERY and since % _LOCALISE_EVERY):
            return None
        result = self._matcher.localise(points_m)
        if result is None or result.is_suspect or result.score < self._config.min_score:
            return None
        widening = 2.0 ** min(self.num_lost, _MAX_DOUBLINGS) * (_MEASURED if is_measured else 1.0)
        return (result, True) if self._is_near(result, guesses, widening) else None

    def _is_near(self, result: RegistrationResult, guesses: list[SE3], widening: float) -> bool:
        jumps = [guess.inv() @ result.T_map_lidar for guess in guesses]
        return any(
            np.linalg.norm(jump.translation) <= self._config.max_jump_m * widening
            and jump.angle_rad <= np.deg2rad(self._config.max_jump_deg) * widening
            for jump in jumps
        )


def _is_at(T: SE3, prediction: SE3) -> bool:
    difference = prediction.inv() @ T
    return bool(np.linalg.norm(difference.translation) <= _JUST_THERE_M and difference.angle_rad <= _JUST_THERE_RAD)
