"""The way that something went, as short lines."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


class Trail:
    """Positions in, lines out. A line is drawn once and stays, so a long way costs no more than a short one.

    step_m: shorter steps wait for the next, so that standing still draws nothing. is_dashed: every second line is left
    out, so that another trail in the same place can be seen too.
    """

    def __init__(self, step_m: float, *, is_dashed: bool = False) -> None:
        self._step_m, self._is_dashed = step_m, is_dashed
        self._last_m: NDArray[np.float64] | None = None
        self._is_gap = False

    def step(self, position_m: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """The line (2, 3) from the end of the trail to this position, or None where there is none to draw."""
        last_m = self._last_m
        distance_m = np.inf if last_m is None else float(np.linalg.norm(position_m - last_m))
        if distance_m < self._step_m:
            return None
        self._last_m, self._is_gap = position_m, self._is_dashed and not self._is_gap
        return None if last_m is None or self._is_gap else np.stack([last_m, position_m])
