"""A climb without any bus: the facades of simulation and player, one calling the other."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

from services.player.player import Player
from services.sim.climbing_sim import ClimbingSim
from services.sim.node import load_sim
from shared.messaging.messages import Event, JointState, JointTarget, LegState, LegTarget, Message
from shared.runtime.config import Config


def climb_messages(config: Config, player: Player) -> Iterator[Message]:
    """All that the simulation says, in order, until the player has reached the end of its trajectory.

    Raises:
        InputFileError: robot or structure are not usable. RefusedError, PlaybackError: the climb cannot be carried out.
    """
    sim = load_sim(config)
    try:
        yield from _answered(sim, player, sim.start())
        while not player.is_done:
            yield from _answered(sim, player, sim.step())
    finally:
        sim.close()


def _answered(sim: ClimbingSim, player: Player, said: list[Message]) -> Iterator[Message]:
    """What the simulation said, and what it answers to the player's commands upon it."""
    waiting = deque(said)
    while waiting:
        message = waiting.popleft()
        yield message
        for command in _commands(player, message):
            if isinstance(command, JointTarget):
                waiting.extend(sim.set_joint_target(command))
            elif isinstance(command, LegTarget):
                waiting.extend(sim.set_fixed_foot(command))


def _commands(player: Player, message: Message) -> list[Message]:
    match message:
        case JointState():
            return player.add_joint_state(message)
        case LegState():
            return player.add_leg_state(message)
        case Event():
            return player.add_event(message)
    return []
