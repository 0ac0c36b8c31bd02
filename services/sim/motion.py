"""How the joints move to a target: a straight line in joint space at constant speed, all joints arriving together."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Joints = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class JointMotion:
    """From `q_start` at `start_ns` to `q_end`, `duration_ns` later; at rest before and after. q: (J,) rad or m."""

    q_start: Joints
    q_end: Joints
    start_ns: int = 0
    duration_ns: int = 0

    def at(self, stamp_ns: int) -> tuple[Joints, Joints]:
        """Positions and velocities (J,) at a time; exactly `q_end` from the end on."""
        elapsed_ns = stamp_ns - self.start_ns
        if elapsed_ns >= self.duration_ns:
            return self.q_end, np.zeros_like(self.q_end)
        if elapsed_ns < 0:
            return self.q_start, np.zeros_like(self.q_start)
        way = self.q_end - self.q_start
        return self.q_start + elapsed_ns / self.duration_ns * way, way / (self.duration_ns * 1e-9)


def plan_motion(
    q_start: Joints, q_end: Joints, start_ns: int, max_velocity: Joints, duration_s: float = 0.0
) -> JointMotion:
    """The motion that takes `duration_s`, or longer where a joint would be faster than `max_velocity` (J,)."""
    needed_s = float(np.max(np.abs(q_end - q_start) / max_velocity))
    return JointMotion(q_start, q_end, start_ns, math.ceil(max(needed_s, duration_s) * 1e9))
