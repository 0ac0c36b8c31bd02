"""The postures that a robot may go through while one foot is fixed, and the straight ways between them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shared.climbing.climber import Climber
from shared.climbing.stance import Stance
from shared.climbing.transit import line_samples
from shared.geometry import Float

_SAMPLE_M = 6e-3
"""Between samples of a way; a point is then never farther than half of it from where it was checked."""
CLEARANCES_M = (_SAMPLE_M / 2, 1e-3, 0.0)
"""What is kept from steel in the air, as far as there is room: the first means that nothing between samples cuts."""
CONTACT_M = 0.5e-3
"""A foot that lifts or lands may seem to be in its steel by this."""


class StepSpace:
    """Free: within the joint limits, no deeper than allowed, and the fixed foot holds with `min_margin`."""

    def __init__(self, climber: Climber, stance: Stance, min_margin: float) -> None:
        self.climber = climber
        self.stance = stance
        self.min_margin = min_margin
        self.surroundings = climber.collisions.around(stance)

    def holds(self, q: Float) -> NDArray[np.bool_]:
        """Whether the fixed foot holds in each posture (S, 8)."""
        return np.asarray(self.climber.holding.margins(self.stance, q) >= self.min_margin)

    def is_free(self, q: Float, clearance_m: float) -> bool:
        """Whether all postures (S, 8) are free; a clearance below 0 allows as much depth."""
        if clearance_m < 0:
            is_clear = self.surroundings.contacts(q).depth_m <= -clearance_m
        else:
            is_clear = self.surroundings.is_free(q, clearance_m)
        return bool(is_clear.all()) and bool(self.holds(q).all())

    def is_way_free(self, q_start: Float, q_end: Float, clearance_m: float, step_m: float = _SAMPLE_M) -> bool:
        """Whether the straight line in joint space between two postures (8,) is."""
        if not self.is_free(q_end[None], clearance_m):
            return False
        bodies = self.climber.collisions.bodies
        return self.is_free(line_samples(q_start, q_end, self.stance, bodies, step_m), clearance_m)

    def duration_s(self, q_start: Float, q_end: Float) -> Float:
        """At the velocity limits (...), for postures (..., 8)."""
        longest: Float = (np.abs(q_end - q_start) / self.climber.max_velocity).max(axis=-1)
        return longest
