"""`hyrecro cloud`: finds planes in clouds, filters them, saves them from the bus."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cli.options import DEFAULT_CONFIG, ConfigOption, JsonOption, SetOption, resolved

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from cli.cloud_filtering import FilterSteps
    from shared.cloud_planes import CloudPlane
    from shared.runtime.config import Config

app = typer.Typer(no_args_is_help=True)


@app.command()
def planes(
    file: Annotated[Path | None, typer.Argument(metavar="FILE.pcd|.ply|.las", help="Instead: --live.")] = None,
    live: Annotated[bool, typer.Option("--live", help="Takes the newest cloud from the bus.")] = False,
    key: Annotated[str | None, typer.Option(help="Where --live looks; default the map.")] = None,
    max_: Annotated[int, typer.Option("--max", min=1, help="How many planes at most.")] = 11,
    threshold: Annotated[float, typer.Option(help="Metres from a plane within which points are its own.")] = 0.04,
    method: Annotated[str, typer.Option(metavar="ransac|region", help="Largest planes, or connected ones.")] = "ransac",
    save: Annotated[Path | None, typer.Option(help="Writes the coloured cloud: .ply, .pcd or .las.")] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the picture; default out/<UTC time>/.")] = None,
    config: ConfigOption = DEFAULT_CONFIG,
    set_: SetOption = None,
    is_json: JsonOption = False,
) -> None:
    """Finds the planes of a cloud, the largest first, and draws them in colours; points on none are black.

    With --json a picture is drawn only into --out. Exit code 3 where there is no plane.
    """
    from shared.cloud_planes import METHODS
    from shared.runtime.exit_codes import Exit

    if (file is None) == (not live):
        raise typer.BadParameter("either FILE or --live")
    if method not in METHODS:
        raise typer.BadParameter(f"--method: '{method}' is none of {', '.join(METHODS)}")
    if not (math.isfinite(threshold) and threshold > 0):
        raise typer.BadParameter("--threshold: must be above 0")
    settings = resolved(config, set_)
    points_m = _points(file, key, settings)
    found = METHODS[method](points_m, max_, threshold, settings.seed)
    name = str(file or key or "the map")
    if save is not None:
        from cli.cloud_pictures import colours_of
        from shared.cloud_files import write_cloud

        write_cloud(save, points_m, colours_of(len(points_m), found))
    picture = _drawn(points_m, found, name, out, settings) if out is not None or not is_json else None
    _print_planes(name, len(points_m), method, found, picture, is_json=is_json)
    if not found:
        _warn(f"{name}: {len(points_m)} points, no plane among them")
        raise typer.Exit(Exit.PARTIAL)


@app.command("filter")
def filter_(
    in_: Annotated[Path, typer.Argument(metavar="IN")],
    out: Annotated[Path, typer.Argument(metavar="OUT", help=".pcd, .ply or .las; replaced if it is there.")],
    voxel: Annotated[float | None, typer.Option(help="One point, the mean, a voxel of this edge in metres.")] = None,
    range_: Annotated[
        str | None, typer.Option("--range", metavar="MIN,MAX", help="From the origin, in metres.")
    ] = None,
    crop: Annotated[str | None, typer.Option(metavar="X0,X1,Y0,Y1,Z0,Z1", help="Keeps a box.")] = None,
    outliers: Annotated[
        str | None, typer.Option(metavar="K,DEV", help="Far from K neighbours by DEV standard deviations.")
    ] = None,
) -> None:
    """Writes the points of a cloud that pass: finite, in range, in the box, no outliers; then thins them.

    These are the mapper's own filters, in its order; each is left out where nothing is said. Exit code 3 where nothing
    is left.
    """
    from cli.cloud_filtering import filtered_cloud
    from shared.cloud_files import read_cloud, unit_warning, write_cloud
    from shared.errors import CloudFileError
    from shared.runtime.exit_codes import Exit

    steps = _steps(voxel, range_, crop, outliers)
    points_m = read_cloud(in_).points_m
    if text := unit_warning(points_m):
        _warn(f"{in_}: {text}")
    try:
        left_m, counts = filtered_cloud(points_m, steps)
    except ValueError as error:
        raise CloudFileError(f"{in_}: {error}") from error
    write_cloud(out, left_m)
    gone = [
        f"{count} {verdict.name.lower().replace('_', ' ')}" for verdict, count in counts.items() if verdict and count
    ]
    typer.echo(f"{in_}: {len(points_m)} points{''.join(f', {text}' for text in gone)}\n{out}: {len(left_m)} points")
    if len(left_m) == 0:
        _warn(f"{in_}: " + ("has no points" if len(points_m) == 0 else "no point is left"))
        raise typer.Exit(Exit.PARTIAL)


@app.command("save")
def save_(
    key: Annotated[str | None, typer.Option(help="Where clouds come; default the LiDAR's scans.")] = None,
    out: Annotated[Path | None, typer.Option(help="Folder; numbers go on in it. Default out/<UTC time>/.")] = None,
    every: Annotated[float | None, typer.Option(min=0, help="Seconds; without it, Enter saves a cloud.")] = None,
    num: Annotated[int | None, typer.Option(min=1, help="Ends after so many.")] = None,
    config: ConfigOption = DEFAULT_CONFIG,
    set_: SetOption = None,
) -> None:
    """Saves clouds from the bus as data0.pcd, data1.pcd ...: at each Enter, or by itself; Ctrl-C ends it."""
    from cli.cloud_saving import CloudSaver, EnterKey, Every, save_clouds
    from cli.live_clouds import cloud_channel, cloud_stream
    from shared.messaging.channels import LIDAR_POINTS
    from shared.runtime.exit_codes import Exit
    from shared.runtime.run_folder import make_run_folder, run_name
    from shared.runtime.stop_signal import StopSignal

    if every is None and not sys.stdin.isatty():
        raise typer.BadParameter("without a terminal there is no key to press: give --every S")
    channel = LIDAR_POINTS if key is None else cloud_channel(key)
    settings = resolved(config, set_)
    stop = StopSignal()
    with cloud_stream(settings, channel, stop.is_set) as stream:
        folder = out or make_run_folder(settings.recorder, run_name(settings.recorder))
        saver, trigger = CloudSaver(folder), EnterKey() if every is None else Every(every)
        if every is None:
            print("Enter saves a cloud, Ctrl-C ends", file=sys.stderr)
        num_saved = save_clouds(stream, saver, trigger, num, stop.is_set, lambda text: print(text, file=sys.stderr))
    typer.echo(f"{num_saved} clouds in {folder}")
    raise typer.Exit(stop.exit_code() if stop.is_set() else Exit.FINE)


def _points(file: Path | None, key: str | None, config: Config) -> NDArray[np.float64]:
    if file is not None:
        from cli.clouds import finite_points

        return finite_points(file, _warn)
    from cli.live_clouds import cloud_channel, live_points
    from shared.messaging.channels import MAP_CLOUD
    from shared.runtime.stop_signal import StopSignal

    channel = MAP_CLOUD if key is None else cloud_channel(key)
    with StopSignal() as stop:
        return live_points(config, channel, stop.is_set)


def _drawn(points_m: NDArray[np.float64], found: list[CloudPlane], name: str, out: Path | None, config: Config) -> Path:
    from cli.cloud_pictures import draw_planes
    from shared.errors import InputFileError
    from shared.runtime.run_folder import make_run_folder, run_name

    folder = out or make_run_folder(config.recorder, run_name(config.recorder))
    path = folder / "planes.png"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        draw_planes(path, points_m, found, f"{name}: {len(found)} planes in {len(points_m)} points")
    except OSError as error:
        raise InputFileError(f"{path}: {error.strerror or error}") from error
    return path


def _print_planes(
    name: str, num_points: int, method: str, found: list[CloudPlane], picture: Path | None, *, is_json: bool
) -> None:
    from cli.cloud_pictures import plane_colour

    num_off = num_points - sum(len(plane.rows) for plane in found)
    if is_json:
        rows = [
            {"coefficients": plane.coefficients.tolist(), "inliers": len(plane.rows), "colour": plane_colour(number)}
            for number, plane in enumerate(found)
        ]
        figures = {"cloud": name, "method": method, "points": num_points, "off_plane_points": num_off, "planes": rows}
        typer.echo(json.dumps(figures, indent=2))
        return
    for number, plane in enumerate(found):
        x, y, z, d = plane.coefficients.tolist()
        typer.echo(f"plane {number:3d}  {x:+.5f} x {y:+.5f} y {z:+.5f} z {d:+.5f} m = 0  {len(plane.rows)} points")
    typer.echo(f"{num_points} points, {num_off} off the planes\n{picture}")


def _steps(voxel: float | None, range_: str | None, crop: str | None, outliers: str | None) -> FilterSteps:
    from cli.cloud_filtering import FilterSteps

    if voxel is not None and not (math.isfinite(voxel) and voxel > 0):
        raise typer.BadParameter("--voxel: must be above 0")
    box = None if crop is None else _numbers("--crop", crop, 6)
    limits = None if range_ is None else _numbers("--range", range_, 2)
    far = None if outliers is None else _numbers("--outliers", outliers, 2)
    for name, values in (("--crop", box or []), ("--range", limits or [])):
        if any(low >= high for low, high in zip(values[::2], values[1::2], strict=True)):
            raise typer.BadParameter(f"{name}: each first number must be below its second")
    if far is not None and not (far[0] >= 1 and far[0].is_integer() and far[1] > 0):
        raise typer.BadParameter("--outliers: must be a whole number of neighbours and a number above 0")
    return FilterSteps(
        range_m=None if limits is None else (limits[0], limits[1]),
        crop_m=None if box is None else (box[0], box[1], box[2], box[3], box[4], box[5]),
        outliers=None if far is None else (int(far[0]), far[1]),
        voxel_m=voxel,
    )


def _numbers(name: str, text: str, count: int) -> list[float]:
    try:
        values = [float(word) for word in text.split(",")]
    except ValueError:
        values = []
    if len(values) != count or any(math.isnan(value) for value in values):
        raise typer.BadParameter(f"{name}: must be {count} numbers with commas between, got '{text}'")
    return values


def _warn(text: str) -> None:
    print(f"hyrecro: {text}", file=sys.stderr)
