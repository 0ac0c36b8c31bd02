"""When the joints are where: the postures of a planned step in simulated time."""

from __future__ import annotations

import numpy as np

from services.planner.step_planning import StepPlan
from shared.geometry import Float
from shared.messaging.messages import FootPhase
from shared.robot.ramps import ramped_share

PHASES = (FootPhase.LIFT, FootPhase.TRANSFER, FootPhase.LANDING)


class Schedule:
    """A step in which each straight line is as fast as `speed_share` of the velocity limits max_velocity (8,) lets it.

    Each phase begins and ends at rest, with `ramp_s` to get up to speed and as long to stop; a phase that is shorter
    than a ramp is slower throughout.
    """

    def __init__(self, plan: StepPlan, max_velocity: Float, speed_share: float, ramp_s: float = 0.0) -> None:
        self._phases = [_Phase(q, speed_share * max_velocity, ramp_s) for q in (plan.lift, plan.transfer, plan.landing)]

    @property
    def duration_s(self) -> float:
        """From the first posture to the last."""
        return sum(phase.total_s for phase in self._phases)

    @property
    def q_end(self) -> Float:
        """The posture (8,) with the foot on its steel."""
        return self._phases[-1].q_at(np.inf)

    def q_at(self, time_s: float) -> Float:
        """The posture (8,) at a time after the start; the last one from the end on."""
        _, phase, time_in_phase_s = self._at(time_s)
        return phase.q_at(time_in_phase_s)

    def phase_at(self, time_s: float) -> FootPhase:
        """What the foot is doing."""
        return self._at(time_s)[0]

    def _at(self, time_s: float) -> tuple[FootPhase, _Phase, float]:
        for name, phase in zip(PHASES[:-1], self._phases[:-1], strict=True):
            if time_s <= phase.total_s + 1e-9:
                return name, phase, time_s
            time_s -= phase.total_s
        return PHASES[-1], self._phases[-1], time_s


class _Phase:
    """Straight lines between postures q (N, 8), with a ramp before the first and after the last."""

    def __init__(self, q: Float, velocity: Float, ramp_s: float) -> None:
        self._q = q
        pieces_s = (np.abs(np.diff(q, axis=0)) / velocity).max(axis=1)
        self._times_s = np.concatenate([[0.0], np.cumsum(pieces_s)])
        even_s = float(self._times_s[-1])
        self.total_s = max(even_s + ramp_s, 2 * ramp_s) if even_s > 0 else 0.0
        self._ramp_s = ramp_s

    def q_at(self, time_s: float) -> Float:
        share = ramped_share(time_s, self.total_s, self._ramp_s)[0]
        return np.array([np.interp(share * self._times_s[-1], self._times_s, column) for column in self._q.T])
