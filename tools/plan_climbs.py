"""Plans the climbs in configs/trajectories with the planner: `python tools/plan_climbs.py [NAME ...]`.

Each starts where the simulation starts. A row is a straight line in joint space that `hyrecro robot check` accepts.
"""

from __future__ import annotations

import contextlib
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cli.trajectory_check import check_trajectory, initial_stance, print_reports
from services.planner.schedule import PHASES
from services.planner.step_planning import StepPlan, plan_step
from services.planner.step_space import CONTACT_M, StepSpace
from services.planner.tree_search import without_needless
from shared.climbing.climber import Climber, load_climber
from shared.climbing.stance import Stance
from shared.errors import RefusedError
from shared.geometry import SE3, Float
from shared.messaging.messages import JOINT_NAMES, Foot, FootTarget
from shared.runtime.config import CONFIGS_DIR, Config, PlannerConfig
from shared.runtime.config_loading import load_config

A, B = Foot.A, Foot.B
UP, DOWN, SOUTH, EAST = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (0.0, -1.0, 0.0), (1.0, 0.0, 0.0)
NUM_SEARCHES = 8
MARGINS = (0.1, 0.08, 0.06, 0.05, 0.03, 0.0)


@dataclass(frozen=True)
class Step:
    """A foot's place: a point on steel, the normal there, and how the foot is turned about it; None = as it likes."""

    foot: Foot
    point_m: tuple[float, float, float]
    normal: tuple[float, float, float]
    turn_deg: float | None = None

    def target(self) -> FootTarget:
        """As it is said to the planner."""
        if self.turn_deg is None:
            return FootTarget(foot=self.foot, point_m=np.array(self.point_m), normal=np.array(self.normal))
        centre = np.array(self.point_m) + 0.005 * np.array(self.normal)
        T_world_foot = SE3.from_z_axis(self.normal, centre) @ SE3.rot("z", np.deg2rad(self.turn_deg))
        return FootTarget(foot=self.foot, T_world_foot=T_world_foot.xyz_quat_xyzw)


TO_POST = (Step(B, (0, -0.35, 10.1), UP), Step(A, (0, -0.1, 10.3), SOUTH))
"""From the beam's top onto the post's side that faces it."""
ROUND_POST = (
    *TO_POST,
    Step(B, (0.05, -0.1, 10.55), SOUTH, turn_deg=90),
    Step(A, (0.1, -0.03, 10.5), EAST),
    Step(B, (0.1, 0.0, 10.3), EAST),
)
CLIMBS = {
    "along_bar": (
        Step(A, (0, -1.0, 10.1), UP),
        Step(B, (0, -1.35, 10.1), UP),
        Step(A, (0, -1.2, 10.1), UP),
        Step(B, (0, -1.6, 10.1), UP),
        Step(A, (0, -1.8, 10.1), UP),
    ),
    "bar_to_post": (*TO_POST, Step(B, (0, -0.1, 10.45), SOUTH), Step(A, (0, -0.1, 10.65), SOUTH)),
    "round_post": ROUND_POST,
    "post_to_upper_bar": (
        *TO_POST,
        Step(B, (0, -0.1, 10.45), SOUTH),
        Step(A, (0, -0.1, 10.75), SOUTH),
        Step(B, (0, -0.1, 11.05), SOUTH),
        Step(A, (0, -0.1, 11.35), SOUTH),
        Step(B, (0, -0.1, 11.55), SOUTH),
        Step(A, (0, -0.35, 11.8), DOWN),
        Step(B, (0, -0.55, 11.8), DOWN),
    ),
    "climb": (
        *ROUND_POST,
        Step(A, (0.4, 0, 10.1), UP),
        Step(B, (0.65, 0, 10.1), UP),
        Step(A, (1.0, 0, 10.1), UP),
        Step(B, (1.3, 0, 10.1), UP),
    ),
}


def safest_climb(steps: Sequence[Step], climber: Climber, config: Config) -> list[Float | None]:
    """The rows of the climb with the greatest of MARGINS that leaves a way.

    Raises:
        RefusedError: there is none with the least of them either.
    """
    for margin in MARGINS[:-1]:
        with contextlib.suppress(RefusedError):
            return plan_climb(steps, climber, config, config.planner.model_copy(update={"min_margin": margin}))
    return plan_climb(steps, climber, config, config.planner.model_copy(update={"min_margin": MARGINS[-1]}))


def plan_climb(steps: Sequence[Step], climber: Climber, config: Config, planner: PlannerConfig) -> list[Float | None]:
    """The rows of a climb: postures (8,), None to change the fixed foot."""
    stance, q = initial_stance(config), np.zeros(len(JOINT_NAMES))
    rows: list[Float | None] = []
    for step in steps:
        if step.foot is stance.fixed_foot:
            stance = stance.changed(q)
            rows.append(None)
        rows += shortest(step.target(), stance, q, climber, planner)
        q = rows[-1]  # type: ignore[assignment]
    return rows


def shortest(target: FootTarget, stance: Stance, q: Float, climber: Climber, planner: PlannerConfig) -> list[Float]:
    """The rows of a step out of some random searches: safest up to a margin of 0.1, then fewest rows, then quickest."""
    steps = []
    for seed in range(NUM_SEARCHES):
        plan = plan_step(target, stance, q, climber, planner, np.random.default_rng(seed))
        rows = few_rows(plan, climber)
        duration_s = np.abs(np.diff([q, *rows], axis=0) / climber.max_velocity).max(axis=1).sum()
        lack = math.ceil(20 * max(0.0, 0.1 - plan.margin))  # in twentieths: half a hundredth is no reason for a detour
        steps.append((lack, len(rows), duration_s, seed, rows))
        if not lack and len(rows) == len(PHASES):
            break
    return min(steps)[-1]


def few_rows(plan: StepPlan, climber: Climber) -> list[Float]:
    """The ends of as few straight lines as will do, at least one for each of lift, transfer and landing."""
    space = StepSpace(climber, plan.stance, min(plan.margin, MARGINS[0]) - 1e-9)
    rows: list[Float] = []
    for phase in (plan.lift, plan.transfer, plan.landing):
        rows += without_needless(list(phase), lambda a, b: space.is_way_free(a, b, -CONTACT_M))[1:]
    return rows


def write_rows(path: Path, rows: Sequence[Float | None]) -> None:
    """As `services.player.trajectory` reads them; microns and microradians are kept, and never a limit exceeded."""
    lines = [",".join(JOINT_NAMES)]
    lines += [",".join(["C"] * len(JOINT_NAMES)) if q is None else ",".join(f"{x:.6f}" for x in q) for q in rows]
    path.write_text("\n".join(lines) + "\n")


def main(names: Sequence[str]) -> int:
    """Writes and checks the named climbs, or all."""
    config = load_config()
    climber = load_climber(config)
    code = 0
    for name in names or CLIMBS:
        path = CONFIGS_DIR / "trajectories" / f"{name}.csv"
        rows = safest_climb(CLIMBS[name], climber, config)
        write_rows(path, rows)
        print(f"{name}: {len(rows)} rows, {sum(q is not None for q in rows)} of them moves")
        code = max(code, print_reports(check_trajectory(path, config), is_json=False))
    return code


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
