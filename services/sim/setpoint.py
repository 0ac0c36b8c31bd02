"""The drives' own trajectory generator: follows a commanded motion with no more acceleration than allowed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Joints = NDArray[np.float64]


class Setpoint:
    """Positions and velocities (8,) that the drives are given, in rad and m.

    It catches up with its command as fast as it can still brake, then follows without lag. Source: the classical
    time-optimal law, velocity towards the goal = sqrt(2 a distance), made linear near it.

    max_velocity, max_acceleration: (8,), never exceeded.
    """

    def __init__(self, max_velocity: Joints, max_acceleration: Joints, bandwidth_hz: float) -> None:
        self._max_velocity = max_velocity
        self._max_acceleration = max_acceleration
        self._gain = 2 * np.pi * bandwidth_hz
        self.q: Joints = np.zeros(len(max_velocity))
        self.dq: Joints = np.zeros(len(max_velocity))

    def reset(self, q: Joints) -> None:
        """Stands still at q."""
        self.q, self.dq = q.copy(), np.zeros(len(q))

    def braking_distance(self, dq: Joints) -> Joints:
        """How far (8,) joints at dq go on, signed, until they stand."""
        return dq * np.abs(dq) / (2 * self._max_acceleration)

    def follow(self, q: Joints, dq: Joints, step_s: float) -> None:
        """One step towards the command q, which moves at dq."""
        away = q - self.q
        braking = np.sqrt(2 * self._max_acceleration * np.abs(away))
        wanted = dq + np.sign(away) * np.minimum(self._gain * np.abs(away), braking)
        wanted = np.clip(wanted, -self._max_velocity, self._max_velocity)
        change = self._max_acceleration * step_s
        before = self.dq
        self.dq = before + np.clip(wanted - before, -change, change)
        self.q = self.q + 0.5 * (before + self.dq) * step_s
