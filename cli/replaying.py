"""Replays a recording over the bus, with progress on stderr."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

from cli import keyboard
from cli.keyboard import keys
from cli.playback import progress_bar
from services.recorder.bag.overview import Overview, overview_of
from services.recorder.bag.recorded import Recorded, RecordingReader
from services.recorder.replay.channel_choice import chosen
from services.recorder.replay.lockstep import Lockstep, ReplayError
from services.recorder.replay.node import replay_node
from services.recorder.replay.replay import Replay, ReplayOptions
from shared.errors import InputFileError, RefusedError
from shared.messaging.bus import Bus
from shared.messaging.channels import DEPTH_IMAGE, EVENTS, LIDAR_POINTS, MAP_STATUS, Channel
from shared.messaging.messages import MapStatus, ReplayAction, ReplayControl
from shared.runtime.config import Config
from shared.runtime.logs import configure_logs
from shared.runtime.node import Context, Messages
from shared.runtime.runner import run_node

_SEEK_S = 5.0
"""What an arrow key goes on or back by."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayRequest:
    """What the command was asked for. speed: None = 1, in lockstep as fast as the mapper is. Times in seconds."""

    path: Path
    speed: float | None
    is_looping: bool
    is_paused: bool
    is_lockstep: bool
    with_commands: bool
    start_s: float
    end_s: float | None
    patterns: Sequence[str]
    renames: Sequence[str]


def replay(request: ReplayRequest, config: Config, is_stopping: Callable[[], bool]) -> dict[str, Any]:
    """Replays to the end, or until `is_stopping`; returns the figures that `--json` prints.

    Raises:
        InputFileError: the file, or what of it is wanted, is not usable.
        ReplayError: somebody publishes one of the channels, or no mapper answers. BusError: no router.
    """
    configure_logs(verbosity=-1)
    overview = overview_of(request.path)
    recorded = [topic.channel for topic in overview.topics if topic.channel is not None and topic.num_messages]
    channels = chosen(
        recorded,
        request.patterns,
        request.renames,
        with_commands=request.with_commands,
        is_mapped_again=request.is_lockstep,
    )
    if request.is_lockstep:  # nothing may be dropped on the way: the publisher waits
        channels = {channel: output.every() for channel, output in channels.items()}
    options = _options(request, overview, channels)
    lockstep = _lockstep(overview, channels, config) if request.is_lockstep else None
    _refuse_doubles(channels.values(), config)
    readers: list[RecordingReader] = []

    def open_() -> Iterator[Recorded]:
        readers.append(RecordingReader(request.path, lambda channel: channel in channels))
        return readers[-1].messages()

    player = Replay(options, open_, lockstep)
    _run(player, tuple(channels.values()), config, is_stopping, is_lockstep=request.is_lockstep)
    problems = [str(damage) for damage in readers[-1].damage if damage.has_data] + player.unreadable
    return {
        "messages": player.num_sent,
        "channels": sorted(output.key for output in channels.values()),
        "duration_s": overview.duration_s,
        "is_done": player.is_done,
        "problems": problems,
    }


def _run(
    player: Replay, outputs: tuple[Channel, ...], config: Config, is_stopping: Callable[[], bool], *, is_lockstep: bool
) -> None:
    context = Context(clock_ns=time.monotonic_ns)
    node = replay_node(player, outputs, context, is_lockstep=is_lockstep)
    with keys() as pressed, progress_bar() as progress:
        task = progress.add_task("replay", total=1.0)
        is_quit = False

        def stepped() -> Messages:
            nonlocal is_quit
            key = pressed()
            is_quit |= key == "q"
            if (control := _control_of(key, player)) is not None:
                with suppress(RefusedError):
                    player.control(control)
            progress.update(task, completed=player.progress)
            return node.on_timer()

        run_node(dataclasses.replace(node, on_timer=stepped), config, context, lambda: is_quit or is_stopping())


def _control_of(key: str, player: Replay) -> ReplayControl | None:
    match key:
        case " ":
            return ReplayControl(action=ReplayAction.RESUME if player.is_paused else ReplayAction.PAUSE)
        case ".":
            return ReplayControl(action=ReplayAction.STEP)
        case keyboard.LEFT | keyboard.RIGHT:
            way_s = _SEEK_S if key == keyboard.RIGHT else -_SEEK_S
            return ReplayControl(seek_s=max(0.0, player.position_s + way_s))
    return None


def _options(request: ReplayRequest, overview: Overview, channels: dict[Channel, Channel]) -> ReplayOptions:
    end_s = math.inf if request.end_s is None else request.end_s
    if not 0 <= request.start_s <= min(end_s, overview.duration_s):
        until_s = min(end_s, overview.duration_s)
        raise InputFileError(f"{request.path}: --start is {request.start_s:g}, must be within 0 and {until_s:.2f} s")
    return ReplayOptions(
        first_ns=overview.first_ns,
        last_ns=overview.last_ns,
        start_ns=overview.first_ns + round(request.start_s * 1e9),
        end_ns=overview.last_ns if request.end_s is None else overview.first_ns + round(request.end_s * 1e9),
        channels=channels,
        speed=request.speed if request.speed is not None or request.is_lockstep else 1.0,
        is_looping=request.is_looping,
        is_paused=request.is_paused,
    )


def _refuse_doubles(outputs: Iterable[Channel], config: Config) -> None:
    """Two publishers of one key would be taken for one; events alone have many."""
    with Bus(config.bus) as bus:
        taken = bus.published() & {channel.key for channel in outputs} - {EVENTS.key}
    if taken:
        raise ReplayError(
            f"{', '.join(sorted(taken))}: published by another process now; end it, leave the channels out "
            "(--channels), or rename them (--rename)"
        )


def _lockstep(overview: Overview, channels: dict[Channel, Channel], config: Config) -> Lockstep:
    scans = LIDAR_POINTS if config.mapper.input == "lidar" else DEPTH_IMAGE
    if scans not in channels:
        raise InputFileError(f"{overview.path}: --lockstep needs {scans.key}, which is not among what is replayed")
    return Lockstep(scans, _used_scans(overview, scans))


def _used_scans(overview: Overview, scans: Channel) -> frozenset[int] | None:
    """The numbers of the scans that the mapper of that time took; None where none is known."""
    settings = YAML(typ="safe").load(overview.run.get("config", "")) or {}
    of_then = DEPTH_IMAGE if settings.get("mapper", {}).get("input") == "depth" else LIDAR_POINTS
    if of_then != scans:
        return None
    reader = RecordingReader(overview.path, lambda channel: channel == MAP_STATUS)
    statuses = (recorded.message() for recorded in reader.messages())
    return frozenset(status.scan_seq for status in statuses if isinstance(status, MapStatus)) or None
