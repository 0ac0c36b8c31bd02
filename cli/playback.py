"""Plays a trajectory from a command, with progress on stderr."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from services.player.node import node_of
from services.player.player import Player
from services.player.trajectory import read_trajectory
from shared.messaging.channels import JOINTS_STATE
from shared.messaging.messages import JointState, Message
from shared.runtime.config import Config
from shared.runtime.logs import configure_logs
from shared.runtime.node import Context
from shared.runtime.runner import run_node

_PROGRESS_HZ = 4.0
_SILENCE_S = 3.0


class Silence:
    """Says once that no joint state comes any more, and once that they come again. The player waits meanwhile.

    clock_ns: monotonic.
    """

    def __init__(self, clock_ns: Callable[[], int], say: Callable[[str], None]) -> None:
        self._clock_ns, self._say = clock_ns, say
        self._heard_ns, self._is_silent = clock_ns(), False

    def hear(self) -> None:
        """A joint state came."""
        self._heard_ns = self._clock_ns()
        if self._is_silent:
            self._is_silent = False
            self._say("joint states come again: goes on")

    def look(self) -> None:
        """To be called now and then."""
        if not self._is_silent and self._clock_ns() - self._heard_ns > _SILENCE_S * 1e9:
            self._is_silent = True
            self._say(f"no joint state for {_SILENCE_S:g} s (cut off, or paused): waits")


def play_trajectory(config: Config, is_stopping: Callable[[], bool]) -> bool:
    """Plays `config.player.trajectory` over the bus; returns whether it was played to its end.

    Raises:
        InputFileError: the file is not usable. PlaybackError: a command was refused or a target not reached.
        BusError: no router.
    """
    configure_logs(verbosity=-1)
    player = Player(config.player, read_trajectory(config.player.trajectory))
    with progress_bar() as progress:
        task = progress.add_task("climb", total=1.0)
        silence = Silence(time.monotonic_ns, progress.console.print)

        def show() -> list[Message]:
            silence.look()
            progress.update(task, completed=player.progress)
            return []

        def add_joint_state(state: JointState) -> list[Message]:
            silence.hear()
            return player.add_joint_state(state)

        node = node_of(player)
        inputs = {**node.inputs, JOINTS_STATE: add_joint_state}
        node = dataclasses.replace(node, inputs=inputs, on_timer=show, timer_hz=_PROGRESS_HZ)
        run_node(node, config, Context(clock_ns=time.monotonic_ns), is_stopping)
    return player.is_done


def progress_bar() -> Progress:
    """A progress display on stderr that is silent when stderr is not a terminal."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    return Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
