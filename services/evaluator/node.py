"""Wiring of the evaluator."""

from services.evaluator.evaluator import Evaluator
from services.evaluator.state import EvaluatorState
from shared.messaging.channels import EVAL_METRICS, MAP_CLOUD, MAP_ODOMETRY, STRUCTURE_DESCRIPTION, TF, TF_STATIC
from shared.runtime.config import Config
from shared.runtime.node import Context, Memory, Node, Part


def build_node(config: Config, _context: Context) -> Node:
    """The node that compares map/odometry with tf, and map/cloud with the structure."""
    sensor = config.sensors.depth if config.mapper.input == "depth" else config.sensors.lidar
    evaluator = Evaluator(config.evaluator, sensor.frame, config.seed)
    return Node(
        name="evaluator",
        inputs={
            TF: evaluator.add_transforms,
            MAP_ODOMETRY: evaluator.add_odometry,
            MAP_CLOUD: evaluator.add_cloud,
            STRUCTURE_DESCRIPTION: evaluator.set_structure,
        },
        outputs=(EVAL_METRICS, TF_STATIC),
        memory=Memory(
            {"state": Part(EvaluatorState, evaluator.snapshot)}, lambda states: evaluator.restore(states["state"])
        ),
    )
