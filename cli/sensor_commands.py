"""`hyrecro sensor`: what the sensors see."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cli.options import DEFAULT_CONFIG, ConfigOption, SetOption, resolved

app = typer.Typer(no_args_is_help=True)


@app.callback()
def _family() -> None:
    """Keeps `show` a verb of its own while it is the only one."""


@app.command()
def show(
    out: Annotated[Path | None, typer.Option(help="Folder for the pictures; default out/<UTC time>/.")] = None,
    config: ConfigOption = DEFAULT_CONFIG,
    set_: SetOption = None,
) -> None:
    """Draws what LiDAR and depth camera see from the robot's first posture, with the errors of their datasheets.

    Writes scan.png, edge.png (a thin bar met by beams of no and of true width) and depth.png.
    """
    from cli.sensor_pictures import draw_depth, draw_edge, draw_scan, first_view
    from shared.runtime.run_folder import make_run_folder, run_name

    settings = resolved(config, set_)
    folder = out or make_run_folder(settings.recorder, run_name(settings.recorder))
    folder.mkdir(parents=True, exist_ok=True)
    view = first_view(settings)
    draw_scan(folder / "scan.png", settings, view)
    draw_edge(folder / "edge.png")
    draw_depth(folder / "depth.png", settings, view)
    typer.echo(f"{folder}: scan.png, edge.png, depth.png")
