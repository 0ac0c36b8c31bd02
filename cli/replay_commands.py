"""`hyrecro replay`: a recording over the bus again."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated

import typer

from cli.options import DEFAULT_CONFIG, ConfigOption, JsonOption, SetOption, resolved


def register(app: typer.Typer) -> None:
    """Adds the verb."""
    app.command()(replay)


def replay(
    recording: Annotated[Path, typer.Argument(metavar="RUN.mcap", help="A recording, also one that was cut off.")],
    speed: Annotated[
        float | None, typer.Option(min=0.01, max=1000.0, help="Recorded seconds a second; default 1.")
    ] = None,
    start: Annotated[float, typer.Option(min=0.0, metavar="S", help="Seconds after the first message.")] = 0.0,
    end: Annotated[float | None, typer.Option(min=0.0, metavar="S", help="Seconds after the first message.")] = None,
    loop: Annotated[bool, typer.Option("--loop", help="From the start again, until Ctrl-C.")] = False,
    paused: Annotated[bool, typer.Option("--paused", help="Waits for resume or step on replay/control.")] = False,
    channels: Annotated[list[str] | None, typer.Option(metavar="PATTERN", help="Keys, such as lidar/*.")] = None,
    rename: Annotated[list[str] | None, typer.Option(metavar="FROM=TO", help="A key, or what is before its /.")] = None,
    commands: Annotated[bool, typer.Option("--commands", help="Also the commands: they move robots.")] = False,
    lockstep: Annotated[
        bool, typer.Option("--lockstep", help="Each scan the live mapper used, when that before it has been mapped.")
    ] = False,
    config: ConfigOption = DEFAULT_CONFIG,
    set_: SetOption = None,
    is_json: JsonOption = False,
) -> None:
    """Publishes a recording on the bus as it was recorded; on a terminal: space pauses, . steps, arrows seek, q quits.

    Exit code 3 where part of the recording could not be read, 1 where somebody publishes the same channels.
    """
    from cli.replaying import ReplayRequest, replay as run
    from shared.runtime.exit_codes import Exit
    from shared.runtime.stop_signal import StopSignal

    request = ReplayRequest(
        path=recording,
        speed=speed,
        is_looping=loop,
        is_paused=paused,
        is_lockstep=lockstep,
        with_commands=commands,
        start_s=start,
        end_s=end,
        patterns=tuple(channels or ()),
        renames=tuple(rename or ()),
    )
    stop = StopSignal()
    figures = run(request, resolved(config, set_), stop.is_set)
    for problem in figures["problems"]:
        print(f"hyrecro: {recording}: {problem}", file=sys.stderr)
    if is_json:
        print(json.dumps(figures, indent=2))
    else:
        typer.echo(f"{figures['messages']} messages of {len(figures['channels'])} channels")
    if stop.is_set():
        raise typer.Exit(stop.exit_code())
    raise typer.Exit(Exit.PARTIAL if figures["problems"] else Exit.FINE)
