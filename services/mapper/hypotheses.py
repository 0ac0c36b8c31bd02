"""Registers a scan from several candidate poses, and says whether one of them is clearly the best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from services.mapper.registration import Points, Registration, RegistrationResult
from shared.geometry import SE3

_FIRST_GATE_M = 0.3
"""Candidates are this far off, for the scan's farther points."""
_FIRST_STRIDE = 2
_SAME_M = 0.05
_SAME_RAD = 0.03
_RIVAL_SHARE = 0.9
"""Another pose with so much of the best one's score is a rival."""


def best_of(
    registration: Registration, points_lidar_m: Points, starts: Sequence[SE3], max_correspondence_m: float
) -> RegistrationResult | None:
    """The registration of the highest score from these poses T_map_lidar, None without any.

    It is suspect where another, distinct one scores almost as high: the target looks alike in both places.
    """
    results = [_from_afar(registration, points_lidar_m, start, max_correspondence_m) for start in starts]
    if not results:
        return None
    best = max(results, key=lambda result: result.score)
    is_ambiguous = any(
        result.score >= _RIVAL_SHARE * best.score and _are_distinct(result.T_map_lidar, best.T_map_lidar)
        for result in results
    )
    return replace(best, is_suspect=best.is_suspect or is_ambiguous)


def _from_afar(
    registration: Registration, points_lidar_m: Points, start: SE3, max_correspondence_m: float
) -> RegistrationResult:
    gate_m = max(_FIRST_GATE_M, max_correspondence_m)
    coarse = registration.align(points_lidar_m[::_FIRST_STRIDE], start, gate_m)
    return registration.align(points_lidar_m, coarse.T_map_lidar, max_correspondence_m)


def _are_distinct(a: SE3, b: SE3) -> bool:
    step = a.inv() @ b
    return bool(np.linalg.norm(step.translation) > _SAME_M or step.angle_rad > _SAME_RAD)
