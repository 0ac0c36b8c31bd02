"""When the joints are where: the postures of a planned step in simulated time."""

from __future__ import annotations

import numpy as np

from services.planner.step_planning import StepPlan
from shared.geometry import Float
from shared.messaging.messages import FootPhase

PHASES = (FootPhase.LIFT, FootPhase.TRANSFER, FootPhase.LANDING)


class Schedule:
    """A step with each straight line as fast as `speed_share` of the velocity limits max_velocity (8,) lets it be."""

    def __init__(self, plan: StepPlan, max_velocity: Float, speed_share: float) -> None:
        parts = (plan.lift, plan.transfer, plan.landing)
        self._q = np.concatenate([parts[0], parts[1][1:], parts[2][1:]])
        pieces_s = (np.abs(np.diff(self._q, axis=0)) / (speed_share * max_velocity)).max(axis=1)
        self._times_s = np.concatenate([[0.0], np.cumsum(pieces_s)])
        self._phase_ends_s = self._times_s[np.cumsum([len(part) - 1 for part in parts])]

    @property
    def duration_s(self) -> float:
        """From the first posture to the last."""
        return float(self._times_s[-1])

    @property
    def q_end(self) -> Float:
        """The posture (8,) with the foot on its steel."""
        end: Float = self._q[-1]
        return end

    def q_at(self, time_s: float) -> Float:
        """The posture (8,) at a time after the start; the last one from the end on."""
        return np.array([np.interp(time_s, self._times_s, column) for column in self._q.T])

    def phase_at(self, time_s: float) -> FootPhase:
        """What the foot is doing."""
        return PHASES[min(int(np.searchsorted(self._phase_ends_s, time_s, side="left")), len(PHASES) - 1)]
