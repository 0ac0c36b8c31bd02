"""Joint values as people read them: degrees, and millimetres for the pistons, in steps that a hand can set."""

from __future__ import annotations

import math
from dataclasses import dataclass

from shared.geometry import Float
from shared.messaging.messages import JOINT_NAMES
from shared.robot.kinematics import IS_PRISMATIC

COARSE, FINE = 1.0, 0.1
"""Degrees or millimetres."""


@dataclass(frozen=True, slots=True)
class JointScale:
    """One joint's slider. low, high: whole degrees or millimetres inside the joint's limits."""

    name: str
    unit: str
    per_si: float
    low: float
    high: float

    def shown(self, value: float) -> float:
        """A slider's value of radians or metres, within its ends, in fine steps."""
        return min(max(round(value * self.per_si / FINE) * FINE, self.low), self.high)

    def si(self, shown: float) -> float:
        """Radians or metres of a slider's value."""
        return shown / self.per_si

    def label(self, value: float) -> str:
        """The joint's name and where it is, for people."""
        return f"{self.name} {round(value * self.per_si, 1) + 0.0:.1f} {self.unit}"


def joint_scales(lower: Float, upper: Float) -> list[JointScale]:
    """The scales of q1 to q8, of their limits (8,) in radians and metres."""
    rows = zip(JOINT_NAMES, IS_PRISMATIC, lower.tolist(), upper.tolist(), strict=True)
    return [
        _scale(name, "mm", 1e3, *ends) if slides else _scale(name, "\u00b0", math.degrees(1), *ends)
        for name, slides, *ends in rows
    ]


def _scale(name: str, unit: str, per_si: float, lower: float, upper: float) -> JointScale:
    rounding = 1e-6  # a limit of 25 mm must not become 24
    return JointScale(name, unit, per_si, math.ceil(lower * per_si - rounding), math.floor(upper * per_si + rounding))
