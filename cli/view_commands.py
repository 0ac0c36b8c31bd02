"""`hyrecro view`: a recording, or the robot as it is now, in Rerun."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

import typer

from cli.options import DEFAULT_CONFIG, ConfigOption, SetOption, resolved

_MEMORY = re.compile(r"[0-9]+(\.[0-9]+)?(%|[kMGT]i?B)")
_FILE_MEMORY, _LIVE_MEMORY = "75%", "2GiB"


def register(app: typer.Typer) -> None:
    """Adds the verb."""
    app.command()(view)


def view(
    recordings: Annotated[
        list[Path] | None, typer.Argument(metavar="RUN.mcap ...", help="A recording, all its files in turn.")
    ] = None,
    live: Annotated[bool, typer.Option("--live", help="What the robot says now.")] = False,
    web: Annotated[bool, typer.Option("--web", help="As a page for a browser on this machine.")] = False,
    screenshot: Annotated[Path | None, typer.Option(metavar="OUT.png", help="Only a picture, no window.")] = None,
    time: Annotated[float | None, typer.Option(min=0, help="Simulated seconds; default: the end; live: 5.")] = None,
    port: Annotated[int, typer.Option(min=1, max=65535, help="Of the page.")] = 9090,
    memory_limit: Annotated[
        str | None, typer.Option(help="The viewer then drops what is oldest; default 75%, live 2GiB.")
    ] = None,
    config: ConfigOption = DEFAULT_CONFIG,
    set_: SetOption = None,
) -> None:
    """Shows robot, structure, scan, map, planes, trajectories, curves and events in Rerun.

    Exit code 3 where a part of the recording cannot be read or drawn.
    """
    from cli.rerun_viewer import Kind
    from cli.viewing import Request, run_view

    if memory_limit is not None and not _MEMORY.fullmatch(memory_limit):
        raise typer.BadParameter(f"--memory-limit {memory_limit}: must be like 2GiB or 50%")
    _check_usage(bool(recordings), is_live=live, is_web=web, screenshot=screenshot, time_s=time)
    kind = Kind.HEADLESS if screenshot is not None else Kind.PAGE if web else Kind.WINDOW
    request = Request(
        kind=kind,
        recordings=tuple(recordings or ()),
        picture=screenshot,
        time_s=time,
        page_port=port,
        memory_limit=memory_limit or (_LIVE_MEMORY if live else _FILE_MEMORY),
    )
    raise typer.Exit(run_view(request, resolved(config, set_)))


def _check_usage(
    has_recording: bool, *, is_live: bool, is_web: bool, screenshot: Path | None, time_s: float | None
) -> None:
    if has_recording == is_live:
        raise typer.BadParameter("give a recording, or --live")
    if is_web and screenshot is not None:
        raise typer.BadParameter("--web and --screenshot exclude each other")
    if time_s is not None and (is_web or (is_live and screenshot is None)):
        raise typer.BadParameter("--time goes with a recording in a window, and with --screenshot")
    if screenshot is not None and (screenshot.suffix != ".png" or not screenshot.absolute().parent.is_dir()):
        raise typer.BadParameter(f"--screenshot {screenshot}: must end in .png, in a folder that is there")
