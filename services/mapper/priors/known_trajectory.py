"""The sensor moves as a trajectory from elsewhere says; only its steps count, not where it begins."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from services.mapper.priors.interface import step_of
from shared.geometry import SE3
from shared.motion import Motion


class KnownTrajectory:
    """poses: stamps, which increase, and T_any_sensor at each of them.

    Raises:
        ValueError: no poses, or stamps that do not increase.
    """

    def __init__(self, poses: Sequence[tuple[int, SE3]]) -> None:
        self._stamps_ns = np.array([stamp_ns for stamp_ns, _ in poses], dtype=np.int64)
        self._motion = Motion(self._stamps_ns, [[pose.xyz_quat_xyzw] for _, pose in poses])

    def motion(self, start_ns: int, end_ns: int) -> Motion | None:
        """None beyond either end."""
        is_known = self._stamps_ns[0] <= start_ns and end_ns <= self._stamps_ns[-1]
        return self._motion if is_known else None

    def step(self, start_ns: int, end_ns: int) -> SE3 | None:
        """From `motion`."""
        return step_of(self.motion, start_ns, end_ns)

    def correct(self, stamp_ns: int, T_map_sensor: SE3 | None) -> None:
        """What is known stays as it is."""
