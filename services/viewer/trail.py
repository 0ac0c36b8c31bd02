"""The way that something went, as short lines."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_MIN_STEP_M = 0.004
"""Shorter steps wait for the next, so that standing still draws nothing."""
_MAX_STEP_M = 0.5
"""What moves farther at once did not go there: the line breaks."""


class Trail:
    """Positions in, lines out. A line is drawn once and stays, so a long way costs no more than a short one."""

    def __init__(self) -> None:
        self._last_m: NDArray[np.float64] | None = None

    def step(self, position_m: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """The line (2, 3) from the end of the trail to this position, or None where there is none to draw."""
        last_m = self._last_m
        distance_m = np.inf if last_m is None else float(np.linalg.norm(position_m - last_m))
        if distance_m < _MIN_STEP_M:
            return None
        self._last_m = position_m
        return None if last_m is None or distance_m > _MAX_STEP_M else np.stack([last_m, position_m])
