"""How the joints move to a target: a straight line in joint space, all joints arriving together."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shared.robot.ramps import ramped_share

Joints = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class JointMotion:
    """From `q_start` at `start_ns` to `q_end`, `duration_ns` later; at rest before and after. q: (J,) rad or m.

    It speeds up and slows down evenly over `ramp_ns` at either end (at most half of the duration), and is even between.
    """

    q_start: Joints
    q_end: Joints
    start_ns: int = 0
    duration_ns: int = 0
    ramp_ns: int = 0

    def at(self, stamp_ns: int) -> tuple[Joints, Joints]:
        """Positions and velocities (J,) at a time; exactly `q_end` from the end on."""
        share, share_per_ns = ramped_share(stamp_ns - self.start_ns, self.duration_ns, self.ramp_ns)
        if share == 1.0:
            return self.q_end, np.zeros_like(self.q_end)
        way = self.q_end - self.q_start
        return self.q_start + share * way, share_per_ns * 1e9 * way

    def is_over(self, stamp_ns: int) -> bool:
        """Whether it has come to its end by then."""
        return stamp_ns >= self.start_ns + self.duration_ns

    def shifted(self, offset: Joints) -> JointMotion:
        """The same motion with every position moved by an offset (J,)."""
        return replace(self, q_start=self.q_start + offset, q_end=self.q_end + offset)


def plan_motion(
    q_start: Joints,
    q_end: Joints,
    start_ns: int,
    max_velocity: Joints,
    duration_s: float = 0.0,
    ramp_s: float = 0.0,
) -> JointMotion:
    """The motion that takes `duration_s`, or longer where a joint would be faster than `max_velocity` (J,).

    It has ramps of `ramp_s` unless it is asked to take less than two of them: then it is one of a stream of small
    motions, which are even.
    """
    needed_s = float(np.max(np.abs(q_end - q_start) / max_velocity))
    if ramp_s == 0 or 0 < duration_s < 2 * ramp_s or needed_s == 0:
        return JointMotion(q_start, q_end, start_ns, math.ceil(max(needed_s, duration_s) * 1e9))
    total_s = max(needed_s + ramp_s, duration_s, 2 * ramp_s)
    return JointMotion(q_start, q_end, start_ns, math.ceil(total_s * 1e9), round(ramp_s * 1e9))
