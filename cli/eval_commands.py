"""`hyrecro eval`: scores a trajectory and a map in files against the truth."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cli.options import DEFAULT_CONFIG, ConfigOption, JsonOption, SetOption, resolved

if TYPE_CHECKING:
    from cli.evaluation import Evaluation
    from shared.runtime.config import Config


def register(app: typer.Typer) -> None:
    """Adds the command to the top of the command tree."""
    app.command("eval")(evaluate)


def evaluate(
    estimate: Annotated[Path, typer.Option(metavar="E.tum", help="The estimated trajectory.")],
    truth: Annotated[Path, typer.Option(metavar="T.tum", help="The true trajectory.")],
    align: Annotated[str, typer.Option(metavar="first|umeyama|none", help="How the two are laid together.")] = "first",
    max_dt: Annotated[float, typer.Option(min=0, help="Seconds between poses that belong together.")] = 0.02,
    map_: Annotated[Path | None, typer.Option("--map", metavar="M.pcd", help="In the estimate's frame.")] = None,
    structure: Annotated[Path | None, typer.Option(metavar="S.yaml", help="What the map is a map of.")] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the pictures; default out/<UTC time>/.")] = None,
    config: ConfigOption = DEFAULT_CONFIG,
    set_: SetOption = None,
    is_json: JsonOption = False,
) -> None:
    """Scores a trajectory, and the map made along it, against the truth; draws both. With --json only into --out.

    The map is put into the world as the trajectory is; with --align none it is taken to be there.
    """
    from cli.evaluation import MapFiles, evaluate as run
    from services.evaluator.alignment import Alignment

    if align not in list(Alignment):
        raise typer.BadParameter(f"--align: '{align}' is none of {', '.join(Alignment)}")
    if (map_ is None) != (structure is None):
        raise typer.BadParameter("--map and --structure belong together")
    files = None if map_ is None or structure is None else MapFiles(map_, structure)
    settings = resolved(config, set_)
    result = run(estimate, truth, Alignment(align), max_dt, files, settings)
    for warning in result.warnings:
        print(f"hyrecro: {warning}", file=sys.stderr)
    folder = _draw(result, out, settings) if out is not None or not is_json else None
    if is_json:
        typer.echo(json.dumps(result.figures, indent=2))
    else:
        _print(result.figures, folder)


def _draw(result: Evaluation, out: Path | None, settings: Config) -> Path:
    from cli.eval_pictures import draw_evaluation
    from shared.errors import InputFileError
    from shared.runtime.run_folder import make_run_folder, run_name

    folder = out or make_run_folder(settings.recorder, run_name(settings.recorder))
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "eval.json").write_text(json.dumps(result.figures, indent=2) + "\n", encoding="utf-8")
    except OSError as error:
        raise InputFileError(f"{folder}: {error.strerror or error}") from error
    draw_evaluation(folder, result)
    return folder


def _print(figures: dict[str, Any], folder: Path | None) -> None:
    from rich.console import Console
    from rich.table import Table

    console = Console()
    table = Table(show_header=False, title="score")
    for name, text in rows_of(figures):
        table.add_row(name, text)
    console.print(table)
    parts = Table("part of the path", "parts", "RPE RMSE", "rotation", title="relative error by distance")
    for column in parts.columns:
        column.justify = "right"
    for part in figures["rpe_by_distance"]:
        length, num = f"{part['length_m']:g} m", str(part["num_segments"])
        parts.add_row(length, num, f"{part['rmse_m'] * 1000:.2f} mm", f"{part['rot_rmse_deg']:.3f} deg")
    if figures["rpe_by_distance"]:
        console.print(parts)
    if folder is not None:
        files = " ".join(sorted(path.name for path in folder.iterdir() if path.is_file()))
        console.print(f"files in {folder}: {files}", soft_wrap=True, highlight=False)


def rows_of(figures: dict[str, Any]) -> list[tuple[str, str]]:
    """What a table shows of the figures: a name and a text each. Points off planes stand beside the accuracy alone."""

    def mm(key: str) -> str:
        return f"{figures[key] * 1000:.2f} mm"

    def shares(name: str) -> str:
        return ", ".join(f"{figures[f'{name}_{threshold}cm'] * 100:.1f} %" for threshold in (1, 2, 5))

    drift = (
        "" if figures["drift_percent"] is None else f" ({figures['drift_percent']:.3f} % of {figures['path_m']:.2f} m)"
    )
    rows = [
        ("poses compared", f"{figures['num_poses']}, align {figures['align']}"),
        ("ATE RMSE", f"{mm('ate_rmse_m')} (mean {mm('ate_mean_m')}, max {mm('ate_max_m')})"),
        ("ATE rotation RMSE", f"{figures['ate_rot_rmse_deg']:.3f} deg"),
        ("RPE RMSE, a step", f"{mm('rpe_rmse_m')}, {figures['rpe_rot_rmse_deg']:.3f} deg"),
        ("drift at the end", mm("drift_m") + drift),
        ("steps within 5 cm and 1 deg", f"{figures['pairs_ok']} of {figures['num_pairs']}"),
    ]
    if figures["map_accuracy_mean_m"] is None:
        return rows
    rows += [
        ("map accuracy, mean", f"{mm('map_accuracy_mean_m')} over {figures['map_points']} points"),
        ("map accuracy, 95 %", f"{mm('map_accuracy_p95_m')} (max {mm('map_accuracy_max_m')})"),
        ("points off the planes", str(figures["off_plane_points"])),
        ("mean map entropy", "-" if figures["mme"] is None else f"{figures['mme']:.3f}"),
    ]
    if figures["chamfer_m"] is not None:
        rows += [
            ("completeness 1, 2, 5 cm", shares("completeness")),
            ("F-score 1, 2, 5 cm", shares("fscore")),
            ("Chamfer distance", mm("chamfer_m")),
        ]
    return rows
