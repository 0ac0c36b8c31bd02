"""Wiring of the player."""

from services.player.player import Player
from services.player.trajectory import read_trajectory
from shared.messaging.channels import EVENTS, JOINTS_STATE, JOINTS_TARGET, LEG_STATE, LEG_TARGET, ROBOT_STOP
from shared.runtime.config import Config
from shared.runtime.node import Context, Node


def build_node(config: Config, _context: Context) -> Node:
    """The node that plays `config.player.trajectory` once."""
    return node_of(Player(config.player, read_trajectory(config.player.trajectory)))


def node_of(player: Player) -> Node:
    """Inputs and outputs of a player."""
    return Node(
        name="player",
        inputs={
            JOINTS_STATE: player.add_joint_state,
            LEG_STATE: player.add_leg_state,
            EVENTS: player.add_event,
            ROBOT_STOP: player.stop,
        },
        outputs=(JOINTS_TARGET, LEG_TARGET),
        is_done=lambda: player.is_done,
    )
