"""`hyrecro top`: services and channels, live in the terminal."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from cli.options import DEFAULT_CONFIG, ConfigOption, JsonOption, SetOption, resolved


def register(app: typer.Typer) -> None:
    """Adds the verb."""
    app.command()(top)


def top(
    interval: Annotated[float, typer.Option(min=0.1, max=60, help="Seconds between two looks.")] = 1.0,
    once: Annotated[
        bool, typer.Option("--once", help="Prints the tables once; so does a stdout that is a file.")
    ] = False,
    is_json: JsonOption = False,
    config: ConfigOption = DEFAULT_CONFIG,
    set_: SetOption = None,
) -> None:
    """Shows what every service costs and how its messages fare: rates, waits, drops, losses; `q` ends it."""
    from cli.watching import watch
    from shared.runtime.stop_signal import StopSignal

    stop = StopSignal()
    is_once = once or not sys.stdout.isatty()
    settings = resolved(config, set_).bus
    watch(settings, interval_s=interval, is_once=is_once, is_json=is_json, is_stopping=stop.is_set)
    raise typer.Exit(stop.exit_code())
