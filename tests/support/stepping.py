"""Planned steps for tests: one after the other, as the robot would take them."""

import numpy as np

from services.planner.step_planning import plan_step
from shared.climbing.climb_check import ClimbCheck, Row
from shared.climbing.stance import Stance
from shared.geometry import SE3
from shared.messaging.messages import Foot, FootTarget
from shared.runtime.config import PlannerConfig

ZERO = np.zeros(8)
START = Stance(Foot.A, SE3.from_rpy((0, 0, np.pi / 2), (0, -0.775, 10.105)))
"""Where the default configuration starts, on the original structure."""


def at(point_m, normal, foot=None) -> FootTarget:
    return FootTarget(foot=foot, point_m=np.array(point_m, dtype=float), normal=np.array(normal, dtype=float))


def planned(target, stance, q, climber, config=None, seed=1):
    return plan_step(target, stance, q, climber, config or PlannerConfig(), np.random.default_rng(seed))


def walk(climber, stance, steps, q=ZERO, config=None):
    """Plans the steps (foot, target), one after the other; the plans and their reports by `ClimbCheck`."""
    plans, rows, start = [], [], stance
    q_start = q
    for foot, target in steps:
        if foot is stance.fixed_foot:
            stance = stance.changed(q)
            rows.append(None)
        plan = planned(target, stance, q, climber, config)
        plans.append(plan)
        rows += [*plan.lift[1:], *plan.transfer[1:], *plan.landing[1:]]
        q = plan.landing[-1]
    numbered = [Row(line, row) for line, row in enumerate(rows, start=2)]
    return plans, list(ClimbCheck(climber).reports(numbered, start, q_start))
