"""Wiring of the planner."""

from services.planner.planner import StepPlanner
from services.planner.state import PlannerState
from shared.climbing.climber import load_climber
from shared.messaging.channels import (
    EVENTS,
    FOOT_STATUS,
    FOOT_TARGET,
    JOINTS_STATE,
    JOINTS_TARGET,
    LEG_STATE,
    LEG_TARGET,
    ROBOT_STOP,
)
from shared.runtime.config import Config
from shared.runtime.node import Context, Memory, Node, Part


def build_node(config: Config, _context: Context) -> Node:
    """The node that puts feet where they are told to go."""
    planner = StepPlanner(config.planner, load_climber(config), config.seed)
    return Node(
        name="planner",
        inputs={
            FOOT_TARGET: planner.add_foot_target,
            JOINTS_STATE: planner.add_joint_state,
            LEG_STATE: planner.add_leg_state,
            EVENTS: planner.add_event,
            ROBOT_STOP: planner.stop,
        },
        outputs=(JOINTS_TARGET, LEG_TARGET, FOOT_STATUS),
        memory=Memory({"state": Part(PlannerState, planner.snapshot)}, lambda states: planner.restore(states["state"])),
    )
