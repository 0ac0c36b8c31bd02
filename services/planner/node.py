"""Wiring of the planner."""

from services.planner.planner import StepPlanner
from shared.climbing.climber import Climber
from shared.messaging.channels import (
    EVENTS,
    FOOT_STATUS,
    FOOT_TARGET,
    JOINTS_STATE,
    JOINTS_TARGET,
    LEG_STATE,
    LEG_TARGET,
)
from shared.robot.urdf import parse_urdf, read_urdf
from shared.runtime.config import Config
from shared.runtime.node import Context, Node
from shared.world.structure import load_structure


def build_node(config: Config, _context: Context) -> Node:
    """The node that puts feet where they are told to go."""
    model = parse_urdf(read_urdf(config.robot), str(config.robot))
    planner = StepPlanner(config.planner, Climber.of(model, load_structure(config.structure)), config.seed)
    return Node(
        name="planner",
        inputs={
            FOOT_TARGET: planner.add_foot_target,
            JOINTS_STATE: planner.add_joint_state,
            LEG_STATE: planner.add_leg_state,
            EVENTS: planner.add_event,
        },
        outputs=(JOINTS_TARGET, LEG_TARGET, FOOT_STATUS),
    )
