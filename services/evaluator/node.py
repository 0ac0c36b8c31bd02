"""Wiring of the evaluator."""

from services.evaluator.evaluator import Evaluator
from shared.messaging.channels import EVAL_METRICS, MAP_ODOMETRY, TF, TF_STATIC
from shared.runtime.config import Config
from shared.runtime.node import Context, Node


def build_node(config: Config, _context: Context) -> Node:
    """The node that compares map/odometry with tf."""
    evaluator = Evaluator(config.evaluator, config.sensors.lidar.frame)
    return Node(
        name="evaluator",
        inputs={TF: evaluator.add_transforms, MAP_ODOMETRY: evaluator.add_odometry},
        outputs=(EVAL_METRICS, TF_STATIC),
    )
