"""What a planner that was killed leaves to the next one: that a step was under way, which has ended then."""

from __future__ import annotations

from dataclasses import dataclass

from shared.messaging.messages import Foot, Message


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlannerState(Message):
    """foot: that a step was moving, None: no step was under way. progress, stamp_ns: of the last status."""

    num_statuses: int
    stamp_ns: int
    foot: Foot | None
    progress: float
