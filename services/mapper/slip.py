"""A foot that slips is where legs and scans disagree about the way."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from services.mapper.priors.leg_odometry import LegOdometry
from shared.geometry import SE3

_WINDOW_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Disagreement:
    """Of legs and scans about the same way."""

    distance_m: float
    angle_rad: float


class SlipWatch:
    """Compares the ways over the last second, between scans that were tracked.

    max_distance_m, max_angle_rad: what encoders and scans may disagree by without a slip.
    """

    def __init__(self, max_distance_m: float, max_angle_rad: float) -> None:
        self._max_distance_m, self._max_angle_rad = max_distance_m, max_angle_rad
        self._tracked: deque[tuple[int, SE3]] = deque()

    def compare(self, stamp_ns: int, T_map_sensor: SE3, legs: LegOdometry) -> Disagreement | None:
        """Takes a tracked pose, later than the last; None where the legs do not know the way."""
        self._tracked.append((stamp_ns, T_map_sensor))
        while len(self._tracked) > 2 and stamp_ns - self._tracked[1][0] >= _WINDOW_NS:
            self._tracked.popleft()
        start_ns, start = self._tracked[0]
        step = legs.step(start_ns, stamp_ns) if start_ns < stamp_ns else None
        if step is None:
            return None
        difference = step.inv() @ (start.inv() @ T_map_sensor)
        return Disagreement(float(np.linalg.norm(difference.translation)), difference.angle_rad)

    def is_slip(self, found: Disagreement) -> bool:
        """Whether it is more than encoders explain. A slip is told once: the comparison then begins anew."""
        is_slip = found.distance_m > self._max_distance_m or found.angle_rad > self._max_angle_rad
        if is_slip:
            while len(self._tracked) > 1:
                self._tracked.popleft()
        return is_slip

    def forget(self) -> None:
        """Nothing that was tracked before is compared with what comes."""
        self._tracked.clear()
