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
from shared.messaging.messages import Message
from shared.runtime.config import Config
from shared.runtime.logs import configure_logs
from shared.runtime.node import Context
from shared.runtime.runner import run_node

_PROGRESS_HZ = 4.0


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

        def show() -> list[Message]:
            progress.update(task, completed=player.progress)
            return []

        node = dataclasses.replace(node_of(player), on_timer=show, timer_hz=_PROGRESS_HZ)
        run_node(node, config, Context(clock_ns=time.monotonic_ns), is_stopping)
    return player.is_done


def progress_bar() -> Progress:
    """A progress display on stderr that is silent when stderr is not a terminal."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    return Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
