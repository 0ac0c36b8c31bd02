"""`hyrecro map`: maps recorded scans."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cli.options import DEFAULT_CONFIG, ConfigOption, JsonOption, SetOption, resolved

if TYPE_CHECKING:
    from services.mapper.mapper import Mapper
    from services.mapper.priors.interface import Prior
    from shared.messaging.messages import Message


def register(app: typer.Typer) -> None:
    """Adds the verb."""
    app.command(name="map")(map_)


def map_(
    source: Annotated[Path, typer.Argument(metavar="DIR|RUN.mcap", help="data0.pcd, data1.pcd, ...; or a recording.")],
    method: Annotated[str | None, typer.Option(help="A name, or FILE.py:CLASS; default: as configured.")] = None,
    scan_to: Annotated[str | None, typer.Option(help="map or scan: what a scan is aligned to.")] = None,
    num: Annotated[int | None, typer.Option(min=1, help="Only the first so many scans.")] = None,
    voxel: Annotated[float | None, typer.Option(help="Edge of the voxels in metres.")] = None,
    range_: Annotated[float | None, typer.Option("--range", help="Farthest points taken, in metres.")] = None,
    crop: Annotated[str | None, typer.Option(metavar="X0,X1,Y0,Y1,Z0,Z1", help="A box in the sensor's frame.")] = None,
    prior: Annotated[Path | None, typer.Option(metavar="P.tum", help="T_map_lidar a scan, for its steps.")] = None,
    period: Annotated[float | None, typer.Option(min=1e-3, help="Seconds between scans of DIR, to deskew.")] = None,
    refine: Annotated[bool, typer.Option(help="Afterwards estimates all poses and planes together.")] = False,
    map_: Annotated[Path | None, typer.Option("--map", metavar="OUT.pcd", help="Writes it: pcd, ply, las.")] = None,
    trajectory: Annotated[Path | None, typer.Option(metavar="OUT.tum", help="Writes T_map_lidar of each scan.")] = None,
    view: Annotated[bool, typer.Option(help="Shows the map in the Rerun viewer while it grows.")] = False,
    rrd: Annotated[Path | None, typer.Option(metavar="OUT.rrd", help="Writes what --view shows to a file.")] = None,
    config: ConfigOption = DEFAULT_CONFIG,
    set_: SetOption = None,
    is_json: JsonOption = False,
) -> None:
    """Maps recorded scans; the first pose is the identity.

    Exit code 3 where a scan was lost, left out or missing, 1 where nothing could be mapped.
    """
    from cli.map_output import print_summary, write_results
    from cli.map_view import viewed
    from cli.mapping import figures_of, map_scans
    from cli.playback import progress_bar
    from cli.scan_sources import scan_source
    from shared.cloud_files import check_writable
    from shared.errors import HyrecroError
    from shared.runtime.exit_codes import Exit

    given_by_options = {
        "method": method,
        "scan_to": scan_to,
        "voxel_size_m": voxel,
        "max_range_m": range_,
        "crop_m": f"[{crop}]" if crop else None,
    }
    overrides = [f"mapper.{name}={value}" for name, value in given_by_options.items() if value is not None]
    settings = resolved(config, [*(set_ or []), *overrides])
    if map_ is not None:
        check_writable(map_)
    scans = scan_source(source, num, settings.mapper.input, period)
    problems: list[str] = []

    def warn(problem: str) -> None:
        if problem not in problems:
            problems.append(problem)
            print(f"hyrecro: {problem}", file=sys.stderr)

    def note(mapper: Mapper, said: list[Message]) -> None:
        progress.advance(task)
        show(mapper, said)

    given = None if prior is None else _given_prior(prior, scans.num_scans, period)
    with progress_bar() as progress, viewed(view, rrd) as show:
        task = progress.add_task("map", total=scans.num_scans)
        run = map_scans(settings, scans, prior=given, is_refining=refine, warn=warn, on_scan=note)
    if not any(run.is_tracked):
        raise HyrecroError(f"{source}: none of {scans.num_scans} scans could be mapped")
    write_results(run, map_, trajectory)
    figures = figures_of(run, settings)
    if is_json:
        print(json.dumps(figures, indent=2))
    else:
        print_summary(run, figures)
    raise typer.Exit(Exit.PARTIAL if problems or not all(run.is_tracked) else Exit.FINE)


def _given_prior(path: Path, num_scans: int, period_s: float | None) -> Prior:
    """Its rows are those of the scans, one after the other; its stamps are not looked at."""
    from services.mapper.priors.known_trajectory import KnownTrajectory
    from shared.errors import InputFileError
    from shared.trajectory_files import read_tum

    poses = [pose for _, pose in read_tum(path)]
    if len(poses) < num_scans:
        raise InputFileError(f"{path}: has {len(poses)} poses, must have one for each of {num_scans} scans")
    step_ns = round((period_s or 1.0) * 1e9)
    return KnownTrajectory([(number * step_ns, pose) for number, pose in enumerate(poses)])
